"""Wall time for what the monotonic clock has timed.

Reads are timed by the monotonic clock, which no correction bends. Here it is mapped to UTC.

>>> clock = Clock()
>>> clock.now_ns() <= clock.now_ns()
True
"""

from __future__ import annotations

import time

__all__ = ["Clock", "monotonic_ns"]

_JUMP_NS = 1_000_000_000


def monotonic_ns() -> int:
    """CLOCK_MONOTONIC, the clock that the core's readers look at."""
    if hasattr(time, "CLOCK_MONOTONIC"):
        return time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    return time.monotonic_ns()


class Clock:
    """UTC that never runs back.

    The monotonic clock, set by the wall clock again only when that is ahead by a second: so a
    correction of the wall clock does not bend response times, while a suspended machine or a clock
    that is set late still shows, as a jump forward. A wall clock that is set back is not followed.
    """

    def __init__(self) -> None:
        self._shift = time.time_ns() - monotonic_ns()
        self._behind = False

    @property
    def shift_ns(self) -> int:
        """What is to be added to the monotonic clock."""
        return self._shift

    def at(self, monotonic: int) -> int:
        """Nanoseconds since 1970 of a moment of the monotonic clock."""
        return monotonic + self._shift

    def now_ns(self) -> int:
        """Nanoseconds since 1970."""
        return self.at(monotonic_ns())

    def check(self) -> int:
        """Compare with the wall clock: its step in ns, told once each, 0 where there was none.

        A step forward (positive) is followed.
        """
        step = time.time_ns() - self.now_ns()
        if step > _JUMP_NS:
            self._shift += step
            return step
        behind = step < -_JUMP_NS
        told, self._behind = self._behind, behind
        return step if behind and not told else 0
