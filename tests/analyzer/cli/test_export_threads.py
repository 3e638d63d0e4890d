"""Several threads write what one writes: one decodes, all encode."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest

import _modlens
from analyzer.cli.outputs import LARGE_BYTES, MOST_THREADS, threads_for
from analyzer.pool import Pool
from analyzer.pump import Run, pump
from dissectors.craft import craft
from dissectors.errors import SourceError
from tests.conftest import Modlens


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A polled line with requests that nobody answers, and bytes that nobody sent."""
    rng = random.Random(20)
    parts = []
    for _ in range(600):
        unit, address, quantity = rng.randint(1, 9), rng.randint(0, 999), rng.randint(1, 60)
        parts.append(craft(3, unit=unit, values={"address": address, "quantity": quantity}))
        if rng.random() < 0.98:
            values = {"registers": [rng.randint(0, 65_535) for _ in range(quantity)]}
            parts.append(craft(3, unit=unit, direction="response", values=values))
        if rng.random() < 0.02:
            parts.append(rng.randbytes(3))
    poll = b"".join(parts)
    path = tmp_path_factory.mktemp("threads") / "line.bin"
    path.write_bytes(poll * (1 + LARGE_BYTES // len(poll)))
    return path


@pytest.mark.parametrize(
    "out", ["log.csv", "log.jsonl", "log.parquet", "frames:log.pcapng", "findings:log.csv"]
)
def test_threads_write_the_bytes_of_one(
    modlens: Modlens, line: Path, tmp_path: Path, out: str
) -> None:
    table, _, name = out.rpartition(":")
    written = []
    for threads in (1, 2, 3):
        path = tmp_path / f"{threads}-{name}"
        target = f"{table}:{path}" if table else str(path)
        done = modlens("export", line, "--mode", "rtu", "-o", target, "--threads", threads)
        assert (done.status, done.err) == (0, "")
        written.append(path.read_bytes())
    assert len(written[0]) > 1000
    assert written[0] == written[1] == written[2]


def test_a_limit_holds_with_two_threads(modlens: Modlens, line: Path) -> None:
    done = modlens("export", line, "--to", "csv", "--limit", 5, "--threads", 2)
    assert (done.status, len(done.out.splitlines())) == (0, 6)


def test_a_database_is_written_by_the_thread_that_opened_it(
    modlens: Modlens, line: Path, tmp_path: Path
) -> None:
    done = modlens("export", line, "-o", tmp_path / "log.sqlite", "--threads", 2)
    assert (done.status, done.err) == (0, "")


def test_small_recordings_need_no_threads(line: Path, tmp_path: Path) -> None:
    small = tmp_path / "small.bin"
    small.write_bytes(b"\0")
    assert threads_for([str(small)], 2) == 1
    assert threads_for([str(line)], 1) == 1
    assert threads_for([str(line), "-"], 2) == 1
    assert threads_for([str(line), str(small)], 2) == 2
    assert threads_for([str(line)], 1000) == MOST_THREADS
    assert threads_for([str(line)], -1) == 1


class _Number(int):
    """Stands for a batch."""

    row_count = 700


class _Numbers:
    """A run whose batches are numbers."""

    def __init__(self) -> None:
        self.finished = False

    def batches(self) -> Iterator[Any]:
        yield from map(_Number, range(100))

    def finish(self) -> Any:
        self.finished = True
        return _Number(100)


class _Sink:
    """Takes batches up to a number, at which it fails."""

    def __init__(self, error: Exception | None = None) -> None:
        self.name = "sink"
        self.taken: list[Any] = []
        self._error = error

    def put(self, batch: _modlens.Batch) -> None:
        self.taken.append(batch)
        if self._error is not None and len(self.taken) == 10:
            raise self._error


def run_beside(sink: _Sink) -> list[object]:
    run, failures = _Numbers(), list[object]()
    with Pool(2) as pool:
        pump(
            cast(Run, run),
            [sink],
            stop=lambda: False,
            on_failure=lambda _, error: failures.append(error),
            pool=pool,
        )
    assert run.finished
    return failures


def test_batches_keep_their_order_beside() -> None:
    sink = _Sink()
    assert run_beside(sink) == []
    assert sink.taken == list(range(101))


def test_a_full_disk_ends_the_run_beside() -> None:
    failure = SourceError("no space left")
    sink = _Sink(failure)
    assert run_beside(sink) == [failure]
    assert sink.taken == list(range(10))


def test_what_nobody_expects_is_raised_where_the_run_is() -> None:
    sink = _Sink(ValueError("a mistake"))
    with pytest.raises(ValueError, match="a mistake"):
        run_beside(sink)
    assert sink.taken == list(range(10))
