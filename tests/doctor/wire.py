r"""What a receiver hears of a shared pair of wires: also where two speak, or at another rate.

Each transmission is characters with their start; where two overlap, a low level wins (which is the
AND of the bits). Transmissions that nobody else touches are delivered as they are; all others are
sampled as a UART does it.

>>> pair = Pair(Line(9600, 8, "N", 1))
>>> pair.put(0.0, b"\x55\x03")
>>> [byte for _, byte in pair.heard()]
[85, 3]
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from analyzer.line import Line
from tests.support.uart import Uart, Wire

__all__ = ["Pair", "Transmission"]

Heard = list[tuple[float, int]]


@dataclass(frozen=True, slots=True)
class Transmission:
    """Characters of one sender; `pauses` maps a position to the idle time before that character."""

    start_s: float
    data: bytes
    line: Line
    pauses: Mapping[int, float]

    @property
    def character_s(self) -> float:
        """The time of a character."""
        line = self.line
        bits = 1 + line.data_bits + (line.parity != "N") + line.stop_bits
        return bits / line.baud

    @property
    def end_s(self) -> float:
        """After the last stop bit."""
        return self.start_s + len(self.data) * self.character_s + sum(self.pauses.values())

    def characters(self) -> Iterator[tuple[float, int]]:
        """Start and byte of each."""
        now = self.start_s
        for place, byte in enumerate(self.data):
            now += self.pauses.get(place, 0.0)
            yield now, byte
            now += self.character_s


class Pair:
    """The wires; the tap receives with `line`'s settings, or `inverted`."""

    def __init__(self, line: Line, *, inverted: bool = False) -> None:
        """A quiet line."""
        self.line = line
        self.inverted = inverted
        self.sent: list[Transmission] = []

    def put(
        self,
        start_s: float,
        data: bytes,
        pauses: Mapping[int, float] | None = None,
        line: Line | None = None,
    ) -> None:
        """Somebody sends, with the line's settings or their own."""
        if data:
            self.sent.append(Transmission(start_s, data, line or self.line, pauses or {}))

    def heard(self) -> Heard:
        """Each byte that the tap's receiver makes of it, with the end of its stop bit."""
        heard: Heard = []
        for group in _overlapping(sorted(self.sent, key=lambda one: one.start_s)):
            alone = len(group) == 1 and group[0].line == self.line and not self.inverted
            heard += _plain(group[0]) if alone else self._sampled(group)
        return heard

    def _sampled(self, group: list[Transmission]) -> Heard:
        wire = _SharedWire(self.line, group, inverted=self.inverted)
        uart = Uart(self.line)
        return [(one.time_s, one.byte) for one in uart.receive(wire, group[0].start_s - 1e-6)]


class _SharedWire(Wire):
    """The union of everybody's low levels, as a wire that a `Uart` can sample."""

    def __init__(self, line: Line, group: list[Transmission], *, inverted: bool) -> None:
        super().__init__(line, inverted=inverted)
        lows: list[tuple[float, float]] = []
        for one in group:
            alone = Wire(one.line)
            for start_s, byte in one.characters():
                alone.send(bytes([byte]), start_s)
            edges = alone._edges
            lows += zip(edges[::2], edges[1::2], strict=False)
        lows.sort()
        end = -1.0
        for low, high in lows:
            if low > end + 1e-9:
                self._edges += [low, high]
            elif high > end:
                self._edges[-1] = high
            end = max(end, high)

    def is_high(self, time_s: float) -> bool:
        """The level, as the receiver sees it."""
        return (bisect_right(self._edges, time_s) % 2 == 0) != self.inverted


def _plain(one: Transmission) -> Heard:
    return [(start_s + one.character_s, byte) for start_s, byte in one.characters()]


def _overlapping(sent: list[Transmission]) -> Iterator[list[Transmission]]:
    """Groups of transmissions that touch each other, in the order of time."""
    group: list[Transmission] = []
    end_s = 0.0
    for one in sent:
        if group and one.start_s >= end_s:
            yield group
            group = []
        end_s = max(end_s, one.end_s) if group else one.end_s
        group.append(one)
    if group:
        yield group
