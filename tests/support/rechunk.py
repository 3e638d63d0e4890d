"""Recordings with a time for every byte, as other taps would have delivered them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

__all__ = ["TAPS", "Byte", "Read", "exact", "ftdi16", "untimed"]

Byte = tuple[int, str | None, int]
"""When it had come (ns), on which line, which byte."""

Read = tuple[int | None, str | None, bytes]

_TIMER_NS = 16_000_000
_PACKET = 62


def exact(stream: Iterable[Byte]) -> Iterator[Read]:
    """A read a byte, at its time."""
    for time, line, byte in stream:
        yield time, line, bytes([byte])


def ftdi16(stream: Iterable[Byte]) -> Iterator[Read]:
    """An FTDI adapter as it is delivered: 62 bytes, or what there is when its 16 ms have passed."""
    waiting: dict[str | None, bytearray] = {}
    reads: list[Read] = []
    tick = None
    for time, line, byte in stream:
        if tick is None:
            tick = time + _TIMER_NS
        while time >= tick:
            reads += [(tick, name, bytes(data)) for name, data in waiting.items() if data]
            waiting.clear()
            tick += _TIMER_NS
        data = waiting.setdefault(line, bytearray())
        data.append(byte)
        if len(data) == _PACKET:
            reads.append((time, line, bytes(data)))
            data.clear()
    reads += [(tick, name, bytes(data)) for name, data in waiting.items() if data]
    return iter(reads)


def untimed(stream: Iterable[Byte]) -> Iterator[Read]:
    """No times at all, and all bytes of a line in one block where it has the bus for itself."""
    line, data = None, bytearray()
    for _, name, byte in stream:
        if name != line and data:
            yield None, line, bytes(data)
            data.clear()
        line = name
        data.append(byte)
    yield None, line, bytes(data)


TAPS: dict[str, Callable[[Iterable[Byte]], Iterator[Read]]] = {
    "exact": exact,
    "ftdi16": ftdi16,
    "untimed": untimed,
}
