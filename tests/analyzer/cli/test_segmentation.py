"""`--segmentation silence` and `decode --replay`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import UsageError, decode
from analyzer.line import parse_line
from analyzer.session import FileRun
from analyzer.settings import Settings
from tests.conftest import CAPTURES, Modlens

FLOWMETER = CAPTURES / "flowmeter_15l_min" / "recording.jsonl"
LIVE = ("pymodbus_two_units", "pymodbus_disturbed", "pymodbus_timeouts", "pymodbus_late_answers")
LINE = "19200-8E1"
PATIENCE_NS = 50_000_000


def test_silence_alone_finds_the_frames_of_an_exact_clock(modlens: Modlens) -> None:
    """The defaults of the specification are said; 3.5 characters at 9600-8N1."""
    words = ("--line", "9600-8N1", "--table", "frames", "--to", "jsonl")
    done = modlens("decode", FLOWMETER, *words, "--segmentation", "silence")
    assert done.status == 0
    assert "3,646 us (t3.5) ends a frame; more than 1,562 us (t1.5)" in done.err
    rows = [json.loads(line) for line in done.out.splitlines()]
    told = (FLOWMETER.parent / "frames.jsonl").read_text().splitlines()
    assert [row["hex"] for row in rows] == [json.loads(line)["hex"] for line in told]
    assert {row["delimited_by"] for row in rows[:-1]} == {"silence"}


def test_other_silences_cut_elsewhere(modlens: Modlens) -> None:
    """t3.5 in microseconds or characters, t1.5 as a finding."""
    words = ("decode", FLOWMETER, "--line", "9600-8N1", "--segmentation", "silence")
    longer = modlens(*words, "--table", "frames", "--to", "jsonl", "--t35", "20chars")
    assert "20,833 us (t3.5) ends a frame" in longer.err
    assert len(longer.out.splitlines()) < 132
    strict = modlens(*words, "--table", "findings", "--to", "jsonl", "--t15", "100us")
    assert '"code":"gap_in_frame"' in strict.out.replace(" ", "")


def test_decode_in_python_cuts_by_silence_as_the_command_does() -> None:
    told = (FLOWMETER.parent / "frames.jsonl").read_text().splitlines()
    textbook = decode(FLOWMETER, line="9600-8N1", segmentation="silence")
    assert [row.hex.hex() for row in textbook.frames] == [json.loads(line)["hex"] for line in told]
    longer = decode(FLOWMETER, line="9600-8N1", segmentation="silence", t35="20chars", t15="100us")
    assert sum(1 for _ in longer.frames) < len(told)
    with pytest.raises(UsageError, match=r"t35 and t15 go with segmentation silence"):
        decode(FLOWMETER, t35="1750us")
    with pytest.raises(UsageError, match=r"t3.5 is not known; add line 19200-8E1, or t35 1750us"):
        decode(FLOWMETER, segmentation="silence")
    with pytest.raises(UsageError, match="it is one of joint, silence"):
        decode(FLOWMETER, segmentation="textbook")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--segmentation", "silence"), "t3.5 is not known; add --line 19200-8E1, or --t35 1750us"),
        (("--t35", "2000us"), "--t35 and --t15 go with --segmentation silence"),
        (("--segmentation", "silence", "--t35", "2"), "write microseconds as 1750us"),
        (
            ("--segmentation", "silence", "--t35", "2chars"),
            "the length of a character is not known",
        ),
        (
            ("--segmentation", "silence", "--t35", "1750us", "--t15", "2000us"),
            "--t15 is longer than --t35",
        ),
    ],
)
def test_wrong_silences_are_explained(modlens: Modlens, words: tuple[str, ...], said: str) -> None:
    done = modlens("decode", FLOWMETER, *words)
    assert (done.status, done.out) == (2, "")
    assert said in done.err


def test_stats_say_how_often_silence_would_have_cut_otherwise(modlens: Modlens) -> None:
    """Not at all on an exact clock; a bus without silences always."""
    exact = modlens("stats", FLOWMETER, "--line", "9600-8N1")
    assert "t3.5 (3,646 us) alone would split 0 of 132 frames (0.0%)" in exact.out
    glued = modlens("stats", CAPTURES / "pymodbus_no_silence" / "recording.jsonl", "--line", LINE)
    said = " ".join(glued.out.split())
    assert "alone would split" in said
    assert "alone would split 0 of" not in said


def live_rows(name: str, poll_ns: int) -> list[dict[str, Any]]:
    """The frames of a live session over recorded reads, polled while nothing comes."""
    core = Settings(parse_line(LINE)).core(live=True)
    bus = Settings(parse_line(LINE)).add_bus(core, name, clock="utc")
    rows: list[dict[str, Any]] = []
    before = None
    for text in (CAPTURES / name / "recording.jsonl").read_text().splitlines():
        read = json.loads(text)
        whole, part = str(read["t"]).split(".")
        now = int(whole) * 10**9 + int(part.ljust(9, "0")[:9])
        for moment in range((before or now) + poll_ns, now, poll_ns):
            core.poll(moment)
        core.feed(bus, bytes.fromhex(read["hex"]), now)
        rows += [row.as_dict() for row in _rows(core.take())]
        before = now
    core.flush()
    return rows + [row.as_dict() for row in _rows(core.take())]


def _rows(batch: _modlens.Batch) -> list[_modlens.Row]:
    return [*batch.frames, *batch.transactions, *batch.findings]


@pytest.mark.parametrize("poll_ns", [PATIENCE_NS, 7_000_000])
@pytest.mark.parametrize("name", LIVE)
def test_a_replay_gives_the_rows_of_the_live_tap(name: str, poll_ns: int) -> None:
    """Whenever the tap looked at its clock; only the file's name and places differ."""
    path = Path(CAPTURES / name / "recording.jsonl")
    run = FileRun([str(path)], Settings(parse_line(LINE)), replay=True)
    replayed = [row.as_dict() for batch in run.batches() for row in _rows(batch)]
    assert key(replayed) == key(live_rows(name, poll_ns))


def key(rows: list[dict[str, Any]]) -> list[str]:
    """Rows of all tables without what names the file; batches may be cut elsewhere."""
    places = ("bus", "source")
    return sorted(
        json.dumps({k: v for k, v in row.items() if k not in places}, default=str, sort_keys=True)
        for row in rows
    )
