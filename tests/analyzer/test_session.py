"""From sources to sinks: what is handed on, and what happens when a sink or the input fails."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import _modlens
from analyzer import SourceError, UsageError
from analyzer.pump import Run, Sink, pump
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings


class Counter:
    """A sink that counts frames, and fails at a given batch."""

    def __init__(self, name: str, error: Exception | None = None) -> None:
        self.name = name
        self.frames = 0
        self.error = error

    def put(self, batch: _modlens.Batch) -> None:
        """Count, or fail."""
        if self.error is not None:
            raise self.error
        self.frames += len(batch.frames)


def run_through(run: Run, *sinks: Counter, stop: bool = False) -> list[tuple[str, str]]:
    """Pump, and give what failed."""
    failures: list[tuple[str, str]] = []

    def on_failure(sink: Sink, error: Exception) -> None:
        failures.append((sink.name, type(error).__name__))

    pump(run, sinks, stop=lambda: stop, on_failure=on_failure)
    return failures


@pytest.fixture
def recording(captures: Path) -> str:
    """A recording of two units."""
    return str(captures / "pymodbus_two_units" / "recording.jsonl")


def test_every_sink_gets_everything(recording: str) -> None:
    """Each sink gets as many frames as the core counted."""
    run = FileRun([recording], Settings())
    one, other = Counter("one"), Counter("other")
    assert run_through(run, one, other) == []
    assert one.frames == other.frames == sum(run.stats()["buses"][0]["frames"].values())


def test_a_sink_that_fails_leaves_the_others_whole(recording: str) -> None:
    """A full disk or a closed pipe is reported with the name of its sink."""
    run = FileRun([recording], Settings())
    good = Counter("good")
    full = Counter("full", SourceError("full: no space left"))
    closed = Counter("closed", BrokenPipeError())
    assert run_through(run, full, closed, good) == [
        ("full", "SourceError"),
        ("closed", "BrokenPipeError"),
    ]
    assert good.frames == sum(run.stats()["buses"][0]["frames"].values())


def test_without_a_sink_left_reading_ends(tmp_path: Path) -> None:
    """When all sinks have failed, reading ends."""
    path = tmp_path / "long.bin"
    path.write_bytes(bytes.fromhex("010300000001840a") * 500_000)
    run = FileRun([str(path)], Settings())
    run_through(run, Counter("full", SourceError("full")))
    assert sum(run.stats()["buses"][0]["bytes"].values()) < path.stat().st_size / 2


def test_what_was_decided_before_a_stop_is_written(tmp_path: Path) -> None:
    """After a stop request, rows that were already decided are written."""
    path = tmp_path / "long.bin"
    path.write_bytes(bytes.fromhex("010300000001840a") * 100_000)
    run = FileRun([str(path)], Settings())
    sink = Counter("sink")
    run_through(run, sink, stop=True)
    assert sink.frames == sum(run.stats()["buses"][0]["frames"].values()) > 0


def test_what_was_decided_before_an_error_is_written(recording: str, tmp_path: Path) -> None:
    """The second file is a disappointment; the first has been read."""
    bad = tmp_path / "bad.hex"
    bad.write_text("nothing of hex here\n")
    sink = Counter("sink")
    with pytest.raises(SourceError, match=r"bad\.hex"):
        run_through(FileRun([recording, str(bad)], Settings()), sink)
    assert sink.frames > 0


def test_a_missing_file_is_reported_before_anything_is_decoded(recording: str) -> None:
    """A missing file is reported before anything is decoded, even if it is the last one."""
    with pytest.raises(SourceError, match=r"no\.hex: no such file"):
        FileRun([recording, "no.hex"], Settings())


def test_a_recording_is_reported_at_its_beginning_and_end(recording: str) -> None:
    """The status is reported at the beginning and end, with the reader's counters."""
    heard: list[RecordingStatus] = []
    run_through(FileRun([recording], Settings(), on_status=heard.append), Counter("sink"))
    assert [intake.ended for intake in heard] == [False, True]
    assert heard[1].details["records"] == heard[1].details["lines"] > 0
    assert heard[0].format == "chunks"


@pytest.mark.parametrize("size", [1, 7, 64, 1 << 20])
def test_the_size_of_blocks_does_not_show(
    size: int, captures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rows are the same in blocks of any size."""

    def rows() -> Iterator[dict[str, object]]:
        run = FileRun([str(captures / "pymodbus_exceptions" / "recording.jsonl")], Settings())
        for batch in run.batches():
            yield from (row.as_dict() for row in batch.transactions)

    whole = list(rows())
    monkeypatch.setattr("analyzer.sources.files.BLOCK_BYTES", size)
    monkeypatch.setattr("analyzer.sources.files.SAMPLE_BYTES", 100)
    assert list(rows()) == whole


def test_settings_are_checked() -> None:
    """Wrong use is reported before a port is opened."""
    with pytest.raises(UsageError, match="timeout"):
        Settings(timeout_ns=0)


def test_diagnoses_are_given_once(tmp_path: Path) -> None:
    """Whoever ends a run asks for what is left again."""
    path = tmp_path / "bus.hex"
    path.write_text("TX: 11 06 00 c8 00 01 cb 64\nRX: 11 86 02 c2 64\n" * 40)
    run = FileRun([str(path)], Settings(tables=("diagnoses",)))
    found = [row for batch in [*run.batches(), run.finish()] for row in batch.diagnoses]
    assert len({row.code for row in found}) == len(found) > 0
