"""What a recording of bytes says of the line's settings, when nobody can listen again.

The recording was made with some settings, right or wrong. Frames whose checksums fit prove the rate
and the number of bits. Parity then shows in the receiver's marks of line errors: at 8E1 all of 8O1
is marked, and of 8N2, whose second stop bit stands where the parity bit is read, what has an even
number of ones. Without frames, how long the line was low at the start of each character says which
rate the line had, and the recording has to be made again: what was read at a wrong rate is lost.

>>> marked(bytes(range(8)), range(8), "E")
{'E': 8, 'O': 0, 'N2': 4}
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from analyzer.line import Line, parse_line
from analyzer.sources.settings_search import BAUDS, MASKS, evidence, likelihood, listener, pulses

__all__ = ["Heard", "judge", "made_at", "marked", "reads"]

MOST = 1 << 18
"""Bytes that are looked at."""

LEAST = 24
"""Bytes that fewer of say nothing."""

_FIT, _LIKELY, _SHOWN = 0.9, -3.0, 3

_SETTINGS = re.compile(rb"recording bus=[^\0]* settings=(\d+-\d\w[\d.]+) ")
_ERRORS = re.compile(rb"errors=(\d+(?:,\d+)*)")
_ENHANCED_PACKET, _INTERFACE, _SECTION = 6, 1, b"\x0a\x0d\x0d\x0a"
_LEAST_BLOCK, _PACKET_HEAD, _SERIAL_HEAD, _LINK_SERIAL = 12, 28, 12, 250


@dataclass(frozen=True, slots=True)
class Heard:
    """Bytes of one read, its time (None without a clock), the places of marked bytes."""

    data: bytes
    time_ns: int | None
    errors: Sequence[int] = ()


def reads(recording: bytes) -> Iterator[Heard]:
    """The reads of a raw recording (`tap --record`); any other file is one read without a clock.

    The form stands in the core, write/recording.rs. A block that is cut off ends it.
    """
    if not recording.startswith(_SECTION):
        yield Heard(recording[:MOST], None)
        return
    at, serial, place = 0, False, 0
    while at + _LEAST_BLOCK <= len(recording) and place < MOST:
        kind, length = (int.from_bytes(recording[at + i : at + i + 4], "little") for i in (0, 4))
        if length < _LEAST_BLOCK or at + length > len(recording):
            return
        block = recording[at : at + length]
        at += length
        if kind == _INTERFACE:
            serial = int.from_bytes(block[8:10], "little") == _LINK_SERIAL
        elif kind == _ENHANCED_PACKET and serial:
            high, low, size = (int.from_bytes(block[i : i + 4], "little") for i in (12, 16, 20))
            data = block[_PACKET_HEAD + _SERIAL_HEAD : _PACKET_HEAD + size]
            place += len(data)
            rest = block[_PACKET_HEAD + size :]
            yield Heard(data, high << 32 | low, list(_places(rest)))


def _places(options: bytes) -> Iterator[int]:
    found = _ERRORS.search(options)
    yield from map(int, found[1].split(b",") if found else ())


def made_at(recording: bytes) -> Line | None:
    """The line settings that a raw recording names; None where it names none."""
    found = _SETTINGS.search(recording[:MOST]) if recording.startswith(_SECTION) else None
    return None if found is None else parse_line(found[1].decode())


def judge(heard: Sequence[Heard], made: Line | None) -> Iterator[str]:
    """What speaks for which settings, a line each; `made` are those of the recording."""
    data = b"".join(one.data for one in heard)
    if len(data) < LEAST:
        yield f"settings: {len(data)} bytes are too few to say anything"
        return
    known = made or Line(19200, 8, "E", 1)
    for mode, mask in MASKS.items():
        core = listener(mode, known)
        for one in heard:
            core.feed(0, bytes(byte & mask for byte in one.data), one.time_ns)
        core.flush()
        proof = evidence(mode, core)
        if proof:
            rate = f"{made.baud} baud is" if made else "rate and bits are"
            yield f"settings: {rate} right, {mode}: {proof} in {len(data):,} bytes"
            yield from _parity(heard, made)
            return
    yield "settings: no checksum fits"
    yield from _rates(data, made)


def marked(data: bytes, places: Collection[int], read_with: str) -> dict[str, int]:
    """How many marks (or their absence) each kind of character explains otherwise than seen.

    `read_with` is the parity of the receiver, `E` or `O`; the fewer, the likelier.
    """
    odd_read = read_with == "O"
    wrong = dict.fromkeys(("E", "O", "N2"), 0)
    seen = set(places)
    for place, byte in enumerate(data):
        ones = byte.bit_count() & 1
        expected = {"E": odd_read, "O": not odd_read, "N2": ones == (1 if odd_read else 0)}
        for name, error in expected.items():
            wrong[name] += error != (place in seen)
    return wrong


def _parity(heard: Sequence[Heard], made: Line | None) -> Iterator[str]:
    total = sum(len(one.data) for one in heard)
    marks = sum(len(one.errors) for one in heard)
    if made is None or made.parity not in "EO":
        yield "settings: read without a check of parity, so that it stays open"
        return
    if made.data_bits != 8:  # noqa: PLR2004
        return
    sums = dict.fromkeys(("E", "O", "N2"), 0)
    for one in heard:
        for name, count in marked(one.data, one.errors, made.parity).items():
            sums[name] += count
    best = min(sums, key=lambda name: sums[name])
    line = f"{made.baud}-8{best}" + ("" if best == "N2" else "1")
    share = 1 - sums[best] / total
    said = f"{marks:,} of {total:,} bytes marked at {made}"
    if share < _FIT:
        yield f"settings: {said}: no kind of parity explains that; noise, or marks of whole packets"
    else:
        yield f"settings: {line} ({said}; that explains {share:.0%} of them)"


def _rates(data: bytes, made: Line | None) -> Iterator[str]:
    if made is None:
        yield "settings: say by --line what it was recorded with; then the likely rates can be told"
        return
    counts = pulses(data[:4096])
    odds = {
        rate: math.log(usual) + likelihood(counts, made.baud / rate)
        for rate, usual in BAUDS.items()
    }
    best = max(odds.values())
    likely = sorted((rate for rate in odds if odds[rate] - best > _LIKELY), key=lambda r: -odds[r])
    if likely[0] == made.baud:
        fit = f"the pulses fit {made.baud} baud"
        yield f"settings: {fit}; other parity or data bits, damage, or no Modbus"
        return
    rates = " or ".join(str(rate) for rate in likely[:_SHOWN])
    lower = "at least " if data.count(0) > len(data) / 2 else ""
    yield (
        f"settings: recorded at {made.baud}, but the pulses look like {rates} baud"
        f"{', or less' if lower else ''}; the bytes are lost, record again with --detect"
    )
