"""Infers the line's settings from a recording of bytes, without the line.

The recording was made with some settings, right or wrong. Frames with valid checksums prove the
rate and the number of bits. The parity follows from the receiver's marks of line errors: to a
receiver at 8E1 all characters of 8O1 have errors, and of 8N2, whose first stop bit is read as the
parity bit, those with an even number of ones. Without valid frames, the length of the low pulse at
the start of a character shows the rate of the line; the recording has to be made again, because
bytes received at a wrong rate are lost.

>>> parity_mismatches(bytes(range(8)), range(8), "E")
{'E': 8, 'O': 0, 'N2': 4}
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import _modlens
from analyzer.line import Line, parse_line

__all__ = ["RecordedRead", "infer_settings", "parity_mismatches", "reads", "recorded_settings"]

MAX_BYTES = 1 << 18
"""Bytes at the beginning of a recording that are evaluated."""

MIN_BYTES = 24
"""A recording of fewer bytes is not evaluated."""

_MIN_EXPLAINED, _MAX_RATES = 0.9, 3
_BYTES_FOR_RATES = 4096

_ONLY_BYTES = (
    "so the receiver's settings were right, but bytes alone do not tell which they were: rate and"
    " parity are shown by a recording of tap --record"
)

_SETTINGS = re.compile(rb"recording bus=[^\0]* settings=(\d+-\d\w[\d.]+) ")
_ERROR_OFFSETS = re.compile(rb"errors=(\d+(?:,\d+)*)")
_ENHANCED_PACKET, _INTERFACE, _SECTION = 6, 1, b"\x0a\x0d\x0d\x0a"
_MIN_BLOCK_BYTES, _PACKET_HEADER_BYTES, _SERIAL_HEADER_BYTES, _LINK_SERIAL = 12, 28, 12, 250


@dataclass(frozen=True, slots=True)
class RecordedRead:
    """The bytes of one read, its time in ns (None without a clock), the offsets of marked bytes."""

    data: bytes
    time_ns: int | None
    errors: Sequence[int] = ()


def reads(recording: bytes) -> Iterator[RecordedRead]:
    """The reads of a raw recording (`tap --record`); other files are one read without a clock.

    Its format: modlens-pcapng/src/recording.rs. A truncated block ends the recording.
    """
    if not recording.startswith(_SECTION):
        yield RecordedRead(recording[:MAX_BYTES], None)
        return
    at, serial, offset = 0, False, 0
    while at + _MIN_BLOCK_BYTES <= len(recording) and offset < MAX_BYTES:
        kind, length = (int.from_bytes(recording[at + i : at + i + 4], "little") for i in (0, 4))
        if length < _MIN_BLOCK_BYTES or at + length > len(recording):
            return
        block = recording[at : at + length]
        at += length
        if kind == _INTERFACE:
            serial = int.from_bytes(block[8:10], "little") == _LINK_SERIAL
        elif kind == _ENHANCED_PACKET and serial:
            high, low, size = (int.from_bytes(block[i : i + 4], "little") for i in (12, 16, 20))
            data = block[_PACKET_HEADER_BYTES + _SERIAL_HEADER_BYTES : _PACKET_HEADER_BYTES + size]
            offset += len(data)
            rest = block[_PACKET_HEADER_BYTES + size :]
            yield RecordedRead(data, high << 32 | low, list(_error_offsets(rest)))


def _error_offsets(options: bytes) -> Iterator[int]:
    found = _ERROR_OFFSETS.search(options)
    yield from map(int, found[1].split(b",") if found else ())


def recorded_settings(recording: bytes) -> Line | None:
    """The line settings stored in a raw recording; None where there are none."""
    found = _SETTINGS.search(recording[:MAX_BYTES]) if recording.startswith(_SECTION) else None
    return None if found is None else parse_line(found[1].decode())


def infer_settings(recorded_reads: Sequence[RecordedRead], recorded: Line | None) -> Iterator[str]:
    """The conclusions about the line's settings, one line of text each.

    `recorded` are the settings with which the recording was made, None if not known.
    """
    data = b"".join(one.data for one in recorded_reads)
    if len(data) < MIN_BYTES:
        yield f"settings: {len(data)} bytes are too few to tell"
        return
    known = recorded or Line(19200, 8, "E", 1)
    proof = _modlens.proof_in([(one.data, one.time_ns) for one in recorded_reads], known.settings)
    if proof is not None:
        mode, evidence = proof
        found = f"{mode}: {evidence} in {len(data):,} bytes"
        if all(one.time_ns is None for one in recorded_reads):
            yield f"settings: {found}; {_ONLY_BYTES}"
            return
        rate = f"{recorded.baud} baud is" if recorded else "rate and bits are"
        yield f"settings: {rate} right, {found}"
        yield from _parity(recorded_reads, recorded)
        return
    yield "settings: no checksum matches"
    yield from _rates(data, recorded)


def parity_mismatches(
    data: bytes, marked_offsets: Collection[int], receiver_parity: str
) -> dict[str, int]:
    """For each character format the number of bytes whose error mark it contradicts.

    A format contradicts a mark, or a missing mark, if the receiver should have decided otherwise;
    the format with the fewest contradictions is the most likely. `receiver_parity` is `E` or `O`;
    `marked_offsets` are the offsets of the bytes with an error mark.
    """
    odd_read = receiver_parity == "O"
    wrong = dict.fromkeys(("E", "O", "N2"), 0)
    seen = set(marked_offsets)
    for offset, byte in enumerate(data):
        ones = byte.bit_count() & 1
        expected = {"E": odd_read, "O": not odd_read, "N2": ones == (1 if odd_read else 0)}
        for name, error in expected.items():
            wrong[name] += error != (offset in seen)
    return wrong


def _parity(recorded_reads: Sequence[RecordedRead], recorded: Line | None) -> Iterator[str]:
    """The conclusion about parity from the receiver's error marks, given that the rate is right."""
    total = sum(len(one.data) for one in recorded_reads)
    marks = sum(len(one.errors) for one in recorded_reads)
    if recorded is None or recorded.parity not in "EO":
        yield "settings: read without a parity check, so the parity is unknown"
        return
    if recorded.data_bits != 8:  # noqa: PLR2004
        return
    sums = dict.fromkeys(("E", "O", "N2"), 0)
    for one in recorded_reads:
        for name, count in parity_mismatches(one.data, one.errors, recorded.parity).items():
            sums[name] += count
    best = min(sums, key=lambda name: sums[name])
    line = f"{recorded.baud}-8{best}" + ("" if best == "N2" else "1")
    share = 1 - sums[best] / total
    summary = f"{marks:,} of {total:,} bytes with line errors at {recorded}"
    if share < _MIN_EXPLAINED:
        reason = "no parity setting explains that; noise, or an adapter that marks whole packets"
        yield f"settings: {summary}: {reason}"
    else:
        yield f"settings: {line} ({summary}; that explains {share:.0%} of them)"


def _rates(data: bytes, recorded: Line | None) -> Iterator[str]:
    """The conclusion about the rate from pulse lengths, where no checksum is valid."""
    if recorded is None:
        yield "settings: give the settings it was recorded with by --line to get the likely rates"
        return
    likely = _modlens.likely_rates(data[:_BYTES_FOR_RATES], recorded.baud)
    if likely[0] == recorded.baud:
        fit = f"the pulses fit {recorded.baud} baud"
        yield f"settings: {fit}; other parity or data bits, damage, or no Modbus"
        return
    rates = " or ".join(str(rate) for rate in likely[:_MAX_RATES])
    lower = "at least " if data.count(0) > len(data) / 2 else ""
    yield (
        f"settings: recorded at {recorded.baud}, but the pulses look like {rates} baud"
        f"{', or less' if lower else ''}; the bytes are lost, record again with --detect"
    )
