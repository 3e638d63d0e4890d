"""What each bus has carried lately: when the last valid frame came, how much of the time is used.

The counters of the statistics only grow. What they have gained between two looks shows what
happened in between, so that a line that falls silent is seen to be silent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["FAILED", "LATELY_S", "Activity", "BusActivity", "Errors"]

FAILED = ("no_response", "bad_request", "bad_response", "exception")
"""Statuses of transactions that count as errors."""

LATELY_S = 120.0
"""Errors lately are those of so many seconds."""

_SAMPLE_S = 2.0

WINDOW_S = 10.0
"""Over how long the utilization is taken."""

_VALID = ("ok", "no_checksum")


@dataclass(slots=True)
class BusActivity:
    """The activity of one bus: bytes received, when the last valid frame came, utilization."""

    received: int = 0
    valid_frames: int = 0
    last_frame_s: float | None = None
    utilization: float | None = None
    samples: deque[tuple[float, float]] = field(default_factory=deque)

    def update(self, counts: Mapping[str, Any], now: float) -> None:
        """Take the counters of the bus at a moment."""
        self.received = sum(counts["bytes"].values())
        valid = sum(counts["frames"].get(verdict, 0) for verdict in _VALID)
        if valid > self.valid_frames:
            self.valid_frames, self.last_frame_s = valid, now
        if counts["busy_us"] is None:
            return
        self.samples.append((now, counts["busy_us"]))
        while now - self.samples[0][0] > WINDOW_S and now - self.samples[1][0] >= WINDOW_S:
            self.samples.popleft()
        (first, busy_before), (last, busy) = self.samples[0], self.samples[-1]
        if last - first >= 1.0:
            self.utilization = min((busy - busy_before) / 1e6 / (last - first), 1.0)


@dataclass(slots=True)
class Errors:
    """Transactions of a unit with a function over the last minutes, and how many failed."""

    transactions: int = 0
    failed: int = 0
    samples: deque[tuple[float, int, int]] = field(default_factory=lambda: deque([(0.0, 0, 0)]))

    def update(self, row: Mapping[str, Any], now: float) -> None:
        """Takes the counters of the unit and function at a moment."""
        total, failed = row["transactions"], sum(row["statuses"].get(one, 0) for one in FAILED)
        if now - self.samples[-1][0] >= _SAMPLE_S or len(self.samples) == 1:
            self.samples.append((now, total, failed))
        while len(self.samples) > 1 and now - self.samples[1][0] >= LATELY_S:
            self.samples.popleft()
        _, total_before, failed_before = self.samples[0]
        self.transactions, self.failed = total - total_before, failed - failed_before


class Activity:
    """The activity of all buses by name, and the errors of their units."""

    def __init__(self) -> None:
        self._buses: dict[str, BusActivity] = {}
        self._errors: dict[tuple[str, int, int], Errors] = {}

    def update(self, stats: Mapping[str, Any], now: float) -> None:
        """Take the statistics at a moment."""
        for counts in stats.get("buses", ()):
            self._buses.setdefault(counts["bus"], BusActivity()).update(counts, now)
            for row in counts.get("units", ()):
                key = (counts["bus"], row["unit"], row["function"])
                self._errors.setdefault(key, Errors()).update(row, now)

    def errors(self, bus: str, unit: int, function: int) -> Errors:
        """Errors over the last minutes; none where nothing is known."""
        return self._errors.get((bus, unit, function), Errors())

    def of(self, bus: str) -> BusActivity:
        """The activity of a bus; nothing received where it is not known."""
        return self._buses.get(bus, BusActivity())
