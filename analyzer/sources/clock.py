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

__all__ = ["Change", "Clock", "asleep_ns", "monotonic_ns"]

_JUMP_NS = 1_000_000_000
_NAP_NS = 100_000_000
"""A machine that slept for less was busy with something else."""


def _monotonic_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


monotonic_ns: Callable[[], int] = _monotonic_ns if sys.platform == "darwin" else time.monotonic_ns
"""CLOCK_MONOTONIC, the clock that the core's readers look at; Python's own is another on macOS."""


def asleep_ns() -> int:
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
class Change:
    """What became of the clocks: by how much somebody set the wall clock, how long all slept."""

    step_ns: int = 0
    slept_ns: int = 0


class Clock:
    """UTC that never runs back.

    The monotonic clock, set by the wall clock again only when that is ahead by a second: so a
    correction of the wall clock does not bend response times. After a sleep it is followed at once.
    Where somebody has set it forward, the line went on all the while: then it is followed when
    `follow` says that nothing is under way on the line. A wall clock that is set back is not
    followed. `shift_ns` is what is to be added to the monotonic clock.
    """

    def __init__(
        self,
        wall: Callable[[], int] = time.time_ns,
        monotonic: Callable[[], int] = monotonic_ns,
        asleep: Callable[[], int] = asleep_ns,
    ) -> None:
        self._wall, self._monotonic, self._asleep = wall, monotonic, asleep
        self.shift_ns = wall() - monotonic()
        self._slept = asleep()
        self._told = 0

    @property
    def is_late(self) -> bool:
        """Whether the wall clock is ahead, and to be followed."""
        return self._ahead() > _JUMP_NS

    def at(self, monotonic: int) -> int:
        """Nanoseconds since 1970 of a moment of the monotonic clock."""
        return monotonic + self.shift_ns

    def now_ns(self) -> int:
        """Nanoseconds since 1970."""
        return self._monotonic() + self.shift_ns

    def check(self) -> Change:
        """What happened to the clocks since the last look; each step is told once."""
        slept = self._asleep() - self._slept
        if slept >= _NAP_NS:
            self._slept += slept
        else:
            slept = 0
        ahead = self._ahead()
        step = ahead - self._told - slept
        if abs(step) <= _JUMP_NS:
            step = 0
        else:
            self._told = ahead - slept
        if slept:
            self.follow()
        return Change(step, slept)

    def follow(self) -> None:
        """Go by the wall clock again, unless it is behind."""
        ahead = self._ahead()
        if ahead > 0:
            self.shift_ns += ahead
            self._told = 0

    def _ahead(self) -> int:
        return self._wall() - self.now_ns()
