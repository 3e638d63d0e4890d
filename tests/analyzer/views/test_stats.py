"""Counters on the screen."""

from __future__ import annotations

import io

import pytest

import modlens
from analyzer.views.screen import Screen
from analyzer.views.stats import show_stats
from tests.conftest import CAPTURES


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


def test_requests_that_come_again_are_listed() -> None:
    """How often each was sent is counted in the rows; none of this recording comes once only."""
    recording = modlens.decode(CAPTURES / "pymodbus_types" / "recording.jsonl")
    out = io.StringIO()
    show_stats(recording.stats(), Screen(out))
    text = out.getvalue()
    listed = text[text.index("requests that come again") :].split("\n\n")[0].splitlines()[2:]
    sent = {(fields := line.split())[-5]: int(fields[-4]) for line in listed}
    wanted = {"0-65": "address == 0 and quantity == 66", "47-48": "address == 47 and quantity == 2"}
    assert sent == {of: len(recording.transactions.where(rows)) for of, rows in wanted.items()}


def test_rows_that_are_no_requests_are_explained() -> None:
    """Three late answers have rows; without them there is neither the column nor its line."""
    for name, others in (("pymodbus_late_answers", 3), ("pymodbus_types", 0)):
        recording = modlens.decode(CAPTURES / name / "recording.jsonl")
        out = io.StringIO()
        show_stats(recording.stats(), Screen(out))
        assert len(recording.transactions) - recording.doctor()["requests"] == others
        assert ("as well: late answers" in out.getvalue()) == bool(others)
