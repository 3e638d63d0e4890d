"""UTC for moments of the monotonic clock.

Reads are timed by the monotonic clock, which is never set. Here its times are mapped to UTC.

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
"""A shorter difference between the clocks is not a suspension: the process had to wait."""


def _monotonic_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


monotonic_ns: Callable[[], int] = _monotonic_ns if sys.platform == "darwin" else time.monotonic_ns
"""CLOCK_MONOTONIC, which the core's readers use; `time.monotonic_ns` is another clock on macOS."""


def suspended_ns() -> int:
    """Nanoseconds that the machine has been suspended since boot; 0 where it cannot tell.

    On Linux, CLOCK_MONOTONIC stands still in suspension and CLOCK_BOOTTIME does not
    (clock_gettime(2)); on macOS CLOCK_MONOTONIC runs on, and CLOCK_UPTIME_RAW stands still.
    """
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - monotonic_ns()
    if hasattr(time, "CLOCK_UPTIME_RAW"):
        return monotonic_ns() - time.clock_gettime_ns(time.CLOCK_UPTIME_RAW)
    return 0


@dataclass(frozen=True, slots=True)
class ClockChange:
    """Changes of the clocks: how far the wall clock was set, how long the machine was suspended."""

    step_ns: int = 0
    suspended_ns: int = 0


class Clock:
    """UTC that never runs back: the monotonic clock plus `shift_ns`.

    The shift stays constant, so that small corrections of the wall clock (NTP) do not change
    measured response times. It follows the wall clock only when that is ahead by more than a
    second: at once after a suspension; otherwise, where someone has set the clock forward while the
    line was active, when `catch_up` is called, at a pause of the line. A wall clock that is set
    back is not followed.
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
        """Whether the wall clock is ahead by so much that it should be followed."""
        return self._ahead_ns() > _MIN_STEP_NS

    def at(self, monotonic: int) -> int:
        """Convert a moment of the monotonic clock to nanoseconds since 1970."""
        return monotonic + self.shift_ns

    def now_ns(self) -> int:
        """The current time in nanoseconds since 1970."""
        return self._monotonic() + self.shift_ns

    def check(self) -> ClockChange:
        """What has happened to the clocks since the last call; each step is reported once."""
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
        """Set the time to that of the wall clock, unless that is behind."""
        ahead_ns = self._ahead_ns()
        if ahead_ns > 0:
            self.shift_ns += ahead_ns
            self._reported_ns = 0

    def _ahead_ns(self) -> int:
        return self._wall() - self.now_ns()
