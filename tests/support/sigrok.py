"""Sessions of sigrok for tests: characters put on wires bit by bit, and sampled."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence

from analyzer.line import Line

__all__ = ["changes", "samples", "session", "spaced"]

RATE = 1_000_000
"""Samples a second."""

Wire = Sequence[tuple[float, int]]
"""Characters of one wire: the time of the start bit in seconds, the byte."""


def levels(line: Line, byte: int, *, bad: str = "") -> list[int]:
    """The bits of a character in the order of the wire; `bad` is `parity` or `stop`."""
    bits = [0, *(byte >> n & 1 for n in range(line.data_bits))]
    ones = sum(bits) % 2
    if line.parity != "N":
        bits.append((ones if line.parity == "E" else 1 - ones) ^ (bad == "parity"))
    return [*bits, 0 if bad == "stop" else 1, 1]


def samples(
    line: Line, wires: Sequence[Wire], *, inverted: bool = False, bad: dict[int, str] | None = None
) -> bytes:
    """A byte a sample, a bit a wire."""
    seconds = max(start for wire in wires for start, _ in wire) + 0.02
    out = bytearray(int(seconds * RATE))
    for number, wire in enumerate(wires):
        high = bytearray(b"\1") * len(out)
        for at, (start, byte) in enumerate(wire):
            for n, level in enumerate(levels(line, byte, bad=(bad or {}).get(at, ""))[:-1]):
                first = round((start + n / line.baud) * RATE)
                last = round((start + (n + 1) / line.baud) * RATE)
                high[first:last] = bytes([level]) * (last - first)
        for n, level in enumerate(high):
            out[n] |= (level ^ inverted) << number
    return bytes(out)


def changes(line: Line, wire: Wire) -> list[tuple[float, int]]:
    """The levels of a wire where it changes, and at its start: seconds, level."""
    found = [(0.0, 1)]
    for start, byte in wire:
        for n, level in enumerate(levels(line, byte)):
            if level != found[-1][1]:
                found.append((start + n / line.baud, level))
    return found


def session(data: bytes, names: Sequence[str], *, part: int = 30_000) -> bytes:
    """A session file, its samples in parts."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as whole:
        whole.writestr("version", "2")
        probes = "".join(f"probe{n + 1}={name}\n" for n, name in enumerate(names))
        device = f"capturefile=logic-1\ntotal probes=8\nsamplerate=1 MHz\n{probes}unitsize=1\n"
        whole.writestr("metadata", f"[global]\nsigrok version=0.5.2\n\n[device 1]\n{device}")
        for number, start in enumerate(range(0, len(data), part)):
            whole.writestr(f"logic-1-{number + 1}", data[start : start + part])
    return file.getvalue()


def spaced(data: bytes, start: float, line: Line) -> list[tuple[float, int]]:
    """Characters one after the other."""
    time = (1 + line.data_bits + (line.parity != "N") + line.stop_bits) / line.baud
    return [(start + n * time, byte) for n, byte in enumerate(data)]
