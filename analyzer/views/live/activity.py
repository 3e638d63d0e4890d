"""What each bus has carried lately: when the last valid frame came, how much of the time is used.

The counters of the statistics only grow. What they have gained between two looks shows what
happened in between, so that a line that falls silent is seen to be silent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Activity", "BusActivity"]

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


class Activity:
    """The activity of all buses by name."""

    def __init__(self) -> None:
        self._buses: dict[str, BusActivity] = {}

    def update(self, stats: Mapping[str, Any], now: float) -> None:
        """Take the statistics at a moment."""
        for counts in stats.get("buses", ()):
            self._buses.setdefault(counts["bus"], BusActivity()).update(counts, now)

    def of(self, bus: str) -> BusActivity:
        """The activity of a bus; nothing received where it is not known."""
        return self._buses.get(bus, BusActivity())
