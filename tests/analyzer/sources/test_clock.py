"""Wall time for what the monotonic clock has timed."""

from __future__ import annotations

import time

import pytest

from analyzer.sources import clock as clock_module
from analyzer.sources.clock import Clock

S = 10**9


def test_the_clock_never_runs_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small corrections do not show, steps forward are followed, steps back are told once."""
    wall, steady = [1_000 * S], [5 * S]
    monkeypatch.setattr(time, "time_ns", lambda: wall[0])
    monkeypatch.setattr(clock_module, "monotonic_ns", lambda: steady[0])
    clock = Clock()
    assert clock.now_ns() == wall[0]
    steady[0] += S
    wall[0] += S + 400_000_000  # a correction
    assert (clock.check(), clock.now_ns()) == (0, 1_001 * S)
    wall[0] -= 3600 * S  # set back an hour
    assert clock.check() == pytest.approx(-3600 * S, abs=S)
    assert (clock.check(), clock.now_ns()) == (0, 1_001 * S)
    wall[0] = 5_000 * S  # woken from sleep
    assert (clock.check(), clock.now_ns()) == (3_999 * S, 5_000 * S)
    assert clock.at(0) == 5_000 * S - steady[0]
