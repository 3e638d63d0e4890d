"""Settings of a serial line, written as `19200-8E1`.

There are no default settings for a line: with a wrong parity bytes are still received, but marked
as damaged or altered, so the user has to give the settings or have them detected.

>>> line = parse_line("19200-8E1")
>>> line.baud, line.parity, str(line)
(19200, 'E', '19200-8E1')
>>> line.character_ns
572916
"""

from __future__ import annotations

from dataclasses import dataclass

import _modlens
from dissectors.errors import UsageError

__all__ = ["EXAMPLE", "PARITIES", "Line", "parse_line"]

EXAMPLE = "19200-8E1"

PARITIES = ("N", "E", "O", "M", "S")
"""No parity, even, odd, mark (always 1), space (always 0)."""

_SLOWEST = 50
_FASTEST = 12_000_000


@dataclass(frozen=True, slots=True)
class Line:
    """The settings of a line: baud, data bits (5 to 8), parity (`PARITIES`), stop bits (1, 1.5, 2).

    `UsageError` for other values.
    """

    baud: int
    data_bits: int = 8
    parity: str = "E"
    stop_bits: float = 1

    def __post_init__(self) -> None:
        if not _SLOWEST <= self.baud <= _FASTEST:
            raise UsageError(f"{self.baud} baud is out of range; write {_SLOWEST} to {_FASTEST}")
        if self.data_bits not in range(5, 9):
            raise UsageError(f"{self.data_bits} data bits; a character has 5 to 8")
        if self.parity not in PARITIES:
            raise UsageError(f"parity {self.parity!r}; it is one of {', '.join(PARITIES)}")
        if self.stop_bits not in (1, 1.5, 2):
            raise UsageError(f"{self.stop_bits:g} stop bits; write 1, 1.5 or 2")

    def __str__(self) -> str:
        return f"{self.baud}-{self.data_bits}{self.parity}{self.stop_bits:g}"

    @property
    def settings(self) -> tuple[int, int, str, float]:
        """The settings as a tuple for `_modlens.Session.add_bus`."""
        return (self.baud, self.data_bits, self.parity, float(self.stop_bits))

    @property
    def char_bits(self) -> float:
        """Bits of one character on the line: start, data, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits

    @property
    def character_ns(self) -> int:
        """Nanoseconds that one character takes, start and stop bits included."""
        return _modlens.line_timing(*self.settings)[0]


def parse_line(text: str) -> Line:
    """Parse line settings such as `19200-8E1`, `9600,8,N,1` or `9600/7O2`.

    `UsageError` if the text is not of this form.
    """
    try:
        return Line(*_modlens.parse_line(text))
    except ValueError as error:
        raise UsageError(str(error)) from error
