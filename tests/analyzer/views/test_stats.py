"""Counters on the screen."""

from __future__ import annotations

import io

import pytest

from analyzer.views.screen import Screen
from analyzer.views.stats import show_stats


@pytest.mark.parametrize("columns", [80, 160])
def test_findings_are_ranked(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    """Errors before warnings before notes, of each the most frequent first, in words."""
    monkeypatch.setenv("COLUMNS", str(columns))
    counts = {"exception": 90, "local_echo": 1200, "no_response": 7, "retry": 5, "two_masters": 12}
    stream = io.StringIO()
    bus: dict[str, object] = {
        "bus": "a",
        "mode": "rtu",
        "frames": {},
        "bytes": {},
        "units": [],
        "silence": None,
    }
    clockless = {"duration_us": None, "busy_us": None, "utilization": None}
    stats = {"transactions": {}, "buses": [{**bus, **clockless}], "findings": counts}
    show_stats(stats, Screen(stream))
    lines = stream.getvalue().splitlines()
    codes = [line.split()[1] for line in lines if line.strip()[:1].isdigit()]
    assert codes == ["two_masters", "no_response", "exception", "retry", "local_echo"]
    assert all(len(line) <= columns for line in lines)
    assert any(line.split() == ["1,200", "local_echo"] for line in lines)
