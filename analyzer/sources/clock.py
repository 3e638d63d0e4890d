"""Wall time for what the monotonic clock has timed.

Reads are timed by the monotonic clock, which no correction bends. Here it is mapped to UTC.

>>> clock = Clock()
>>> clock.now_ns() <= clock.now_ns()
True
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Clock", "ClockChange", "monotonic_ns", "suspended_ns"]

_MIN_STEP_NS = 1_000_000_000
_MIN_SUSPENSION_NS = 100_000_000
"""A machine that slept for less was busy with something else."""


def _monotonic_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


monotonic_ns: Callable[[], int] = _monotonic_ns if sys.platform == "darwin" else time.monotonic_ns
"""CLOCK_MONOTONIC, the clock that the core's readers look at; Python's own is another on macOS."""


def suspended_ns() -> int:
    """How long the machine has slept since it was started; 0 where it does not tell.

    Linux' CLOCK_MONOTONIC stands still meanwhile and CLOCK_BOOTTIME does not (clock_gettime(2)); on
    macOS the former runs on, and CLOCK_UPTIME_RAW stands still.
    """
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - monotonic_ns()
    if hasattr(time, "CLOCK_UPTIME_RAW"):
        return monotonic_ns() - time.clock_gettime_ns(time.CLOCK_UPTIME_RAW)
    return 0


@dataclass(frozen=True, slots=True)
class ClockChange:
    """What became of the clocks: by how much somebody set the wall clock, how long all slept."""

    step_ns: int = 0
    suspended_ns: int = 0


class Clock:
    """UTC that never runs back.

    The monotonic clock, set by the wall clock again only when that is ahead by a second: so a
    correction of the wall clock does not bend response times. After a sleep it is followed at once.
    Where somebody has set it forward, the line went on all the while: then it is followed when
    `catch_up` says that nothing is under way on the line. A wall clock that is set back is not
    followed. `shift_ns` is what is to be added to the monotonic clock.
    """

    def __init__(
        self,
        wall: Callable[[], int] = time.time_ns,
        monotonic: Callable[[], int] = monotonic_ns,
        suspended: Callable[[], int] = suspended_ns,
    ) -> None:
        self._wall, self._monotonic, self._suspended = wall, monotonic, suspended
        self.shift_ns = wall() - monotonic()
        self._suspended_ns = suspended()
        self._reported_ns = 0

    @property
    def is_behind_wall_clock(self) -> bool:
        """Whether the wall clock is ahead, and to be followed."""
        return self._ahead_ns() > _MIN_STEP_NS

    def at(self, monotonic: int) -> int:
        """Nanoseconds since 1970 of a moment of the monotonic clock."""
        return monotonic + self.shift_ns

    def now_ns(self) -> int:
        """Nanoseconds since 1970."""
        return self._monotonic() + self.shift_ns

    def check(self) -> ClockChange:
        """What happened to the clocks since the last look; each step is told once."""
        suspended_ns = self._suspended() - self._suspended_ns
        if suspended_ns >= _MIN_SUSPENSION_NS:
            self._suspended_ns += suspended_ns
        else:
            suspended_ns = 0
        ahead_ns = self._ahead_ns()
        step_ns = ahead_ns - self._reported_ns - suspended_ns
        if abs(step_ns) <= _MIN_STEP_NS:
            step_ns = 0
        else:
            self._reported_ns = ahead_ns - suspended_ns
        if suspended_ns:
            self.catch_up()
        return ClockChange(step_ns, suspended_ns)

    def catch_up(self) -> None:
        """Go by the wall clock again, unless it is behind."""
        ahead_ns = self._ahead_ns()
        if ahead_ns > 0:
            self.shift_ns += ahead_ns
            self._reported_ns = 0

    def _ahead_ns(self) -> int:
        return self._wall() - self.now_ns()
