"""What a UART receives from a line, also with the wrong settings: bits, not bytes, on the wire.

A `Wire` is a level over time: frames put on it character by character with the line's real
settings. A `Uart` samples it in the middle of each bit, as chips do, with settings of its own, and
gives bytes, wrong ones too, with the marks of parity and framing errors. After a missing stop bit
real chips differ: some take it for the next start bit (16550), others wait for the line to rise.

>>> wire = Wire(Line(9600, 8, "N", 1))
>>> _ = wire.send(bytes([0x55, 0x03]), 0.0)
>>> [one.byte for one in Uart(Line(9600, 8, "N", 1)).receive(wire, 0.0)]
[85, 3]
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

from analyzer.line import Line


@dataclass(frozen=True, slots=True)
class ReceivedCharacter:
    """A byte that a receiver made of the line, when its stop bit was sampled, and its mark."""

    time_s: float
    byte: int
    error: bool


class Wire:
    """The level of a line: high at rest (low with `inverted` wires), bits as they are sent."""

    def __init__(self, line: Line, *, inverted: bool = False) -> None:
        """Describe the senders' settings."""
        self.line = line
        self.inverted = inverted
        self._edges: list[float] = []  # at each the level changes; it is high before the first

    def send(self, data: bytes, start_s: float) -> float:
        """Put characters on the line without a pause; the time after the last stop bit."""
        now = start_s
        for byte in data:
            for low, halves in self._bits(byte):
                if low != len(self._edges) % 2:  # an even number of edges: high
                    self._edges.append(now)
                now += halves / 2 / self.line.baud
        return now

    def _bits(self, byte: int) -> list[tuple[int, int]]:
        """1 for low; how long, in half bits."""
        line = self.line
        levels = [0, *(byte >> bit & 1 for bit in range(line.data_bits))]
        odd = sum(levels) & 1
        parity = {"E": odd, "O": 1 - odd, "M": 1, "S": 0}.get(line.parity)
        if parity is not None:
            levels.append(parity)
        bits = [(int(level), 2) for level in levels]
        bits.append((1, round(2 * line.stop_bits)))
        return [(0 if level else 1, halves) for level, halves in bits]

    def is_high(self, time_s: float) -> bool:
        """The level at a moment, as the receiver sees it."""
        return (bisect_right(self._edges, time_s) % 2 == 0) != self.inverted

    def next_falling_edge(self, after_s: float) -> float | None:
        """The next moment at which the receiver sees it fall."""
        index = bisect_left(self._edges, after_s)
        if index % 2 != int(self.inverted):
            index += 1
        return self._edges[index] if index < len(self._edges) else None

    def next_rising_edge(self, after_s: float) -> float | None:
        """The next moment at which the receiver sees it rise."""
        index = bisect_left(self._edges, after_s)
        if index % 2 == int(self.inverted):
            index += 1
        return self._edges[index] if index < len(self._edges) else None


class Uart:
    """A receiver; `resync` says that a missing stop bit is taken for the next start bit."""

    def __init__(self, line: Line, *, resync: bool = True) -> None:
        """Describe its settings."""
        self.line = line
        self._resync = resync

    def receive(self, wire: Wire, from_s: float) -> Iterator[ReceivedCharacter]:
        """Everything from a moment on, in the order of time."""
        at = wire.next_falling_edge(from_s)
        bit = 1 / self.line.baud
        while at is not None:
            if wire.is_high(at + bit / 2):  # a spike, no start bit
                at = wire.next_falling_edge(at + bit / 2)
                continue
            one, stop_s, low = self._character(wire, at)
            yield one
            stopped = wire.is_high(stop_s)
            if stopped:
                at = wire.next_falling_edge(stop_s)
            elif self._resync and not low:
                at = stop_s - bit / 2
            else:
                up = wire.next_rising_edge(stop_s)
                at = None if up is None else wire.next_falling_edge(up)

    def _character(self, wire: Wire, start_s: float) -> tuple[ReceivedCharacter, float, bool]:
        line, bit = self.line, 1 / self.line.baud
        levels = [wire.is_high(start_s + (place + 1.5) * bit) for place in range(line.data_bits)]
        places = line.data_bits + 1
        byte = sum(level << place for place, level in enumerate(levels))
        error = False
        if line.parity != "N":
            parity = wire.is_high(start_s + (places + 0.5) * bit)
            places += 1
            odd = sum(levels) & 1
            error = parity != bool({"E": odd, "O": 1 - odd, "M": 1, "S": 0}[line.parity])
        stop_s = start_s + (places + 0.5) * bit
        stop = wire.is_high(stop_s)
        return ReceivedCharacter(stop_s, byte, error or not stop), stop_s, byte == 0 and not stop
