"""The last lines of a run, and the statistics."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from analyzer import decode
from analyzer.views.screen import Screen
from analyzer.views.stats import show_stats
from analyzer.views.summary import damaged, summary

STATS = {
    "transactions": {"no_response": 1, "ok": 1234},
    "findings": {"retry": 2},
    "buses": [
        {"frames": {"ok": 2468, "noise": 0}, "bytes": {"ok": 20000, "noise": 0}},
        {"frames": {"ok": 1, "bad_checksum": 3}, "bytes": {"ok": 8, "bad_checksum": 24}},
    ],
}


def test_a_summary_counts_frames_bytes_and_transactions() -> None:
    """All buses together; what did not occur is not mentioned."""
    assert summary(STATS) == [
        "2,472 frames (20,032 bytes): ok 2,469 (20,008), bad_checksum 3 (24)",
        "1,235 transactions: no_response 1, ok 1,234",
        "findings: retry 2 (modlens explain NAME)",
    ]


def test_damage_is_what_did_not_arrive_whole() -> None:
    """Damaged and incomplete frames and noise count as damaged: three here."""
    assert damaged(STATS) == 3


@pytest.mark.parametrize("width", [80, 132])
def test_statistics_fit_the_terminal(
    width: int, captures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Buses, then units and functions, then findings."""
    monkeypatch.setenv("COLUMNS", str(width))
    stream = io.StringIO()
    recording = decode(captures / "pymodbus_exceptions" / "recording.jsonl", line="19200-8E1")
    show_stats(recording.stats(), Screen(stream))
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    assert lines[0].split()[:3] == ["bus", "mode", "seconds"]
    assert any(line.split()[:5] == ["1", "3", "Read", "Holding", "Registers"] for line in lines)
    assert any(line.split() == ["3", "quantity_limit"] for line in lines)
    assert ("p95 ms" in stream.getvalue()) == (width == 132)
