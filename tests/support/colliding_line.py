"""A half-duplex line on which nobody waits for the others: where two send, their bits are ANDed.

It is in for `HalfDuplexLine` where a recording needs collisions. Characters of both are taken
to be in step, which real ones are not; `tests/doctor/wire.py` samples bits.
"""

from __future__ import annotations

from tests.support.line import HalfDuplexLine, Transmission

__all__ = ["CollidingLine"]


class CollidingLine(HalfDuplexLine):
    """What is written while somebody sends is on the line at once."""

    def submit(self, transmission: Transmission) -> None:
        """Mix it into the transmission that is going on; queue it where there is none."""
        going_on = self._queue[-1] if self._queue else None
        if going_on is None or not going_on.data or not transmission.data:
            super().submit(transmission)
            return
        start_ns = self._start(going_on)
        passed = (transmission.submitted_ns - start_ns) // self._char_ns + 1
        at = max(going_on.received, passed, 0)
        if at >= len(going_on.data):
            super().submit(transmission)
            return
        going_on.data = going_on.data[:at] + _mixed(going_on.data[at:], transmission.data)
        going_on.end_ns = start_ns + len(going_on.data) * self._char_ns
        going_on.sender = f"{going_on.sender}+{transmission.sender}"


def _mixed(one: bytes, other: bytes) -> bytes:
    """The AND where both send, and what is left of the longer one."""
    both = bytes(a & b for a, b in zip(one, other, strict=False))
    return both + one[len(both) :] + other[len(both) :]
