"""What ends a tap by itself, and what is written around events."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import _modlens
from analyzer import FilterError
from analyzer.cli.triggers import (
    EventCapture,
    HourlySummary,
    SettingsDoubt,
    StopConditions,
)
from analyzer.exports.sink import Target

ANSWERED = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
REFUSED = bytes.fromhex("010300000001840a"), bytes.fromhex("018302c0f1")
MS = 1_000_000


def batches(kinds: str) -> Iterator[_modlens.Batch]:
    """A transaction each: `.` answered, `x` refused."""
    core = _modlens.Session(_modlens.Functions(), live=True)
    bus = core.add_bus("bus", source="bus", mode="rtu", clock="utc")
    now = 10**18
    for kind in kinds:
        for data in ANSWERED if kind == "." else REFUSED:
            now += 20 * MS
            core.feed(bus, data, now)
        now += 60 * MS
        core.poll(now)
        yield core.take()


def taken(conditions: StopConditions, kinds: str) -> int:
    """How many transactions it lets through."""
    for number, batch in enumerate(batches(kinds), 1):
        conditions.put(batch)
        if conditions.reached:
            return number
    return 0


def test_limits() -> None:
    """A tap ends by number, by time, by an event; an invalid filter is reported at once."""
    assert taken(StopConditions(3, None, None), "......") == 3
    assert taken(StopConditions(None, None, "exception == 2"), "..x...") == 3
    assert taken(StopConditions(None, None, None), "......") == 0
    short = StopConditions(None, 0.01, None)
    time.sleep(0.02)
    assert taken(short, "......") == 1
    with pytest.raises(FilterError):
        StopConditions(None, None, "exceptio == 2")


@pytest.mark.parametrize(
    ("kinds", "files"),
    [
        ("......", []),
        ("....x....", ["..x.."]),
        (".x....", [".x.."]),
        ("..x.x......x.", ["..x.x..", "..x."]),
        ("..xx..", ["..xx.."]),
    ],
)
def test_a_file_around_each_event(kinds: str, files: list[str], tmp_path: Path) -> None:
    """Two before and two after; events that meet share a file; none is lost at the end."""
    target = Target("transactions", "jsonl", str(tmp_path / "event.jsonl"))
    capture = EventCapture(2, "status == 'exception'", target, None)
    for batch in batches(kinds):
        capture.put(batch)
    capture.close()
    found = []
    for path in sorted(tmp_path.iterdir()):
        rows = [json.loads(line) for line in path.read_text().splitlines()]
        found.append("".join("." if row["status"] == "ok" else "x" for row in rows))
    assert found == files
    assert [path.name for path in sorted(tmp_path.iterdir())] == [
        f"event-{number:04d}.jsonl" for number in range(1, len(files) + 1)
    ]
    assert capture.events == len(files)


def test_an_hour_in_a_line() -> None:
    """The hourly summary counts transactions since the last one by status."""
    said: list[str] = []
    counts = [{"ok": 5}, {"ok": 7, "no_response": 1}]
    hourly = HourlySummary(
        lambda: {"transactions": counts.pop(0), "buses": [{"frames": {"ok": 10}}]},
        said.append,
        0.05,
    )
    (batch,) = batches(".")
    while len(said) < 2:
        hourly.put(batch)
        time.sleep(0.01)
    assert "10 frames, 5 transactions: ok 5 since" in said[0]
    assert "0 frames, 3 transactions: ok 2, no_response 1 since" in said[1]


@pytest.mark.parametrize(("damage", "said"), [(1, 1), (0, 0)])
def test_wrong_settings_are_told_after_a_second(damage: int, said: int) -> None:
    """Bytes that are no frames, for two seconds: one message; valid frames: none."""
    now = 0.0
    core = _modlens.Session(_modlens.Functions(), live=True)
    bus = core.add_bus("bus", source="bus", mode="rtu", clock="utc")
    messages: list[str] = []
    doubt = SettingsDoubt(lambda: json.loads(core.stats()), messages.append, lambda: now)
    for step in range(50):
        now = 0.1 * step
        for half in ANSWERED:
            core.feed(bus, bytes(byte ^ 0x55 * damage for byte in half), round(now * 1e9) + 10**18)
        core.poll(round(now * 1e9) + 10**18 + 90 * MS)
        doubt.put(core.take())
    assert len(messages) == said
    assert all("no valid frame" in text for text in messages)
