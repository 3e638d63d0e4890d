"""Describes one frame as a list of blocks: some bytes each, and their meaning.

This is data for the views to draw. The blocks cover the frame: joined, their bytes are the frame
again, however damaged it is.

>>> frame = bytes.fromhex("11 03 006B 0003 7687")
>>> for block in describe(frame, mode="rtu", direction="request"):
...     print(block.data.hex().ljust(6), block.name.ljust(9), block.value.ljust(6), block.meaning)
11     unit      17     unit 17
03     function  3      Read Holding Registers, request
006b   address   107    107 = 0x006B, 400108 (40108)
0003   quantity  3      3 registers, 400108 to 400110
7687   checksum  0x8776 CRC OK
"""

from __future__ import annotations

import binascii
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import _modlens
from dissectors.context import Context, Meaning
from dissectors.field_meaning import field_meaning
from dissectors.pdu import DecodedField, decode, guess_direction
from dissectors.table import EXCEPTION_BIT, LIST_ITEM_BYTES, Direction

__all__ = ["Layer", "Mode", "Piece", "describe", "pdu_of"]

Mode = Literal["rtu", "ascii", "tcp", "pdu"]

Layer = Literal["frame", "mbap", "pdu", "checksum"]

MIN_RTU_BYTES = 4
"""Unit, function code and CRC (serial line specification, section 2.5.1)."""

MBAP_BYTES = 7
"""Transaction, protocol, length and unit identifiers (messaging on TCP/IP, 3.1.3)."""

RESERVED_UNITS = range(248, 256)
"""Reserved on serial lines (serial line specification, 2.2)."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Some bytes of a frame and what they mean.

    - `offset`: where they start on the wire, from 0; in ASCII mode these are characters
    - `data`: the bytes as they were on the wire; empty for something that is missing
    - `name`: the field's name in the table, with its place in a list: `registers[2]`,
    `objects[0].value`
    - `value`: the value as text, in the base that fits it
    - `meaning`: in words, may be empty
    - `layer`: `frame` (unit, delimiters, noise), `mbap`, `pdu` or `checksum`
    - `is_valid`: False where something is wrong with it; `meaning` then says what
    """

    offset: int
    data: bytes
    name: str
    value: str
    meaning: str
    layer: Layer = "pdu"
    is_valid: bool = True


def describe(  # noqa: PLR0913 - all but the frame by keyword
    data: bytes,
    *,
    mode: Mode,
    direction: Direction | Literal["unknown"] = "unknown",
    request: bytes | None = None,
    has_checksum: bool = True,
    functions: _modlens.Functions | None = None,
) -> list[Piece]:
    """The blocks of one frame, in wire order.

    `request` is the PDU (without unit and checksum) that a response answers: with it registers and
    bits get their numbers. `has_checksum` is False for recordings that print frames without one.
    `direction` "unknown" is settled by layout where that can be done, and taken for a request where
    both fit.

    >>> blocks = describe(bytes.fromhex("83 02"), mode="pdu", direction="response")
    >>> [block.value for block in blocks]
    ['0x83', '2']
    """
    body = _PduContext(direction, request, functions, on_serial_line=mode != "tcp")
    if mode == "pdu":
        return list(body.pieces(data, 0))
    if mode == "tcp":
        return list(_tcp(data, body))
    if mode == "ascii":
        return list(_ascii(data, body, has_checksum=has_checksum))
    return list(_rtu(data, body, has_checksum=has_checksum))


def pdu_of(frame: bytes | None, mode: str) -> bytes | None:
    """The PDU in a request's frame; None where there is no frame, or it is not decodable.

    >>> pdu_of(bytes.fromhex("01 03 00 6B 00 03 74 17"), "rtu").hex()
    '03006b0003'
    """
    if not frame:
        return None
    if mode == "tcp":
        return frame[MBAP_BYTES:]
    if mode == "ascii":
        try:
            return binascii.unhexlify(frame.strip()[1:])[1:-1]
        except binascii.Error:
            return None
    return frame[1:-2]


@dataclass(frozen=True, slots=True)
class _PduContext:
    """What is known of the PDU before it is decoded."""

    direction: Direction | Literal["unknown"]
    request: bytes | None
    functions: _modlens.Functions | None
    on_serial_line: bool

    def pieces(self, pdu: bytes, start: int) -> Iterator[Piece]:
        """The blocks of a PDU that starts at offset `start` of the frame."""
        if not pdu:
            text = "no function code: the frame is truncated"
            yield Piece(start, b"", "function", "", text, is_valid=False)
            return
        direction = self._resolved_direction(pdu)
        decoded = decode(pdu, direction, functions=self.functions)
        decoded_request = None
        if self.request is not None and direction == "response":
            decoded_request = decode(self.request, "request", functions=self.functions)
        context = Context(decoded, len(pdu), direction, decoded_request)
        code = pdu[0]
        value = f"0x{code:02X}" if code & EXCEPTION_BIT else str(code)
        meaning = context.title(guessed=self.direction == "unknown")
        yield Piece(start, pdu[:1], "function", value, meaning.text, is_valid=meaning.is_valid)
        for part in decoded.fields:
            yield from _field(part, pdu, context, start)
        if not decoded.complete:
            text = "bytes are missing from here on"
            yield Piece(start + len(pdu), b"", "missing", "", text, is_valid=False)

    def _resolved_direction(self, pdu: bytes) -> Direction:
        if self.direction != "unknown":
            return self.direction
        guessed = guess_direction(pdu, functions=self.functions)
        return "response" if guessed == "response" else "request"

    def unit(self, unit: int, offset: int, layer: Layer = "frame") -> Piece:
        """The block of a unit number; broadcast and reserved numbers exist on serial lines only."""
        text, is_valid = f"unit {unit}", True
        if self.on_serial_line and unit == 0:
            text = "broadcast to all units; none responds"
        elif self.on_serial_line and unit in RESERVED_UNITS:
            text, is_valid = f"unit {unit}, a reserved number", False
        return Piece(offset, bytes([unit]), "unit", str(unit), text, layer, is_valid)


def _field(part: DecodedField, pdu: bytes, context: Context, start: int) -> Iterator[Piece]:
    """The block of one field; a list of numbers gives a block per item, bits one per byte."""
    at, stop = part.offset, part.offset + part.length
    if part.field_type in LIST_ITEM_BYTES or part.field_type == "bits":
        step = LIST_ITEM_BYTES.get(part.field_type, 1)
        for index, here in enumerate(range(at, stop, step)):
            raw = pdu[here : here + step]
            number = int.from_bytes(raw, "big")
            shown = f"{number:08b}" if part.field_type == "bits" else str(number)
            meaning = field_meaning(part, context, index=index, number=number)
            name = f"{part.path}[{index}]"
            yield Piece(start + here, raw, name, shown, meaning.text, is_valid=meaning.is_valid)
        return
    meaning = field_meaning(part, context)
    shown = part.value.hex(" ") if isinstance(part.value, bytes) else str(part.value)
    yield Piece(start + at, pdu[at:stop], part.path, shown, meaning.text, is_valid=meaning.is_valid)


def _rtu(data: bytes, body: _PduContext, *, has_checksum: bool) -> Iterator[Piece]:
    """The blocks of an RTU frame: unit, PDU, CRC (serial line specification, section 2.5.1)."""
    min_bytes = MIN_RTU_BYTES if has_checksum else MIN_RTU_BYTES - 2
    if len(data) < min_bytes:
        yield _noise(data, f"{len(data)} bytes: too short for a frame of at least {min_bytes}")
        return
    end = len(data) - 2 if has_checksum else len(data)
    yield body.unit(data[0], 0)
    pieces = list(body.pieces(data[1:end], 1))
    yield from pieces
    if has_checksum:
        found = int.from_bytes(data[end:], "little")
        expected = _modlens.crc16(data[:end])
        if found != expected and pieces[-1].name == "missing":
            # Where the frame was cut off, its last bytes are those of a field.
            text = "the last bytes before the frame is cut off, not a checksum"
            yield Piece(end, data[end:], "cut off", data[end:].hex(" "), text, is_valid=False)
            return
        meaning = _checksum("CRC", found, expected, width=4)
        shown = f"0x{found:04X}"
        yield Piece(end, data[end:], "checksum", shown, meaning.text, "checksum", meaning.is_valid)


def _tcp(data: bytes, body: _PduContext) -> Iterator[Piece]:
    """The blocks of a TCP frame: MBAP header and PDU (messaging on TCP/IP, section 3.1.3)."""
    if len(data) < MBAP_BYTES:
        yield _noise(data, f"{len(data)} bytes: too short for the MBAP header of {MBAP_BYTES}")
        return
    mbap_id, protocol, length = (int.from_bytes(data[i : i + 2], "big") for i in (0, 2, 4))
    yield Piece(0, data[:2], "mbap_id", str(mbap_id), "transaction identifier", "mbap")
    text = "Modbus" if protocol == 0 else "not Modbus: the protocol identifier must be 0"
    yield Piece(2, data[2:4], "protocol", str(protocol), text, "mbap", protocol == 0)
    follow = len(data) - 6
    text = f"{length} bytes follow"
    if length != follow:
        text = f"the length field says {length}, but {follow} bytes follow"
    yield Piece(4, data[4:6], "length", str(length), text, "mbap", length == follow)
    yield body.unit(data[6], 6, "mbap")
    end = min(len(data), max(MBAP_BYTES, 6 + length))
    yield from body.pieces(data[MBAP_BYTES:end], MBAP_BYTES)
    if data[end:]:
        text = "beyond the length that the header announces"
        yield Piece(end, data[end:], "extra", data[end:].hex(" "), text, "frame", is_valid=False)


def _ascii(data: bytes, body: _PduContext, *, has_checksum: bool) -> Iterator[Piece]:
    """The blocks of an ASCII frame.

    Byte i of unit, PDU and LRC is in the two characters from 1 + 2i (serial line specification,
    section 2.5.2), so the blocks of the binary frame are moved to the offsets of their characters.
    """
    text = data.removesuffix(b"\n").removesuffix(b"\r")
    try:
        binary = binascii.unhexlify(text[1:]) if text[:1] == b":" else b""
    except binascii.Error:
        binary = b""
    if len(binary) < (3 if has_checksum else 2):
        yield _noise(data, "not an ASCII frame: a colon and pairs of hex digits are expected")
        return
    yield Piece(0, data[:1], "start", ":", "start of frame", "frame")
    end = len(binary) - 1 if has_checksum else len(binary)
    pieces = [body.unit(binary[0], 0), *body.pieces(binary[1:end], 1)]
    if has_checksum:
        meaning = _checksum("LRC", binary[end], _modlens.lrc(binary[:end]), width=2)
        shown = f"0x{binary[end]:02X}"
        last = Piece(
            end, binary[end:], "checksum", shown, meaning.text, "checksum", meaning.is_valid
        )
        pieces.append(last)
    for piece in pieces:
        at = 1 + 2 * piece.offset
        yield replace(piece, offset=at, data=data[at : at + 2 * len(piece.data)])
    yield _delimiter(data[len(text) :], len(text))


def _delimiter(tail: bytes, offset: int) -> Piece:
    shown = {b"\r\n": "CR LF", b"\r": "CR", b"\n": "LF"}.get(tail, "")
    is_valid = tail == b"\r\n"
    meaning = "end of frame" if is_valid else "the frame should end in CR LF"
    return Piece(offset, tail, "end", shown, meaning, "frame", is_valid)


def _checksum(kind: str, found: int, expected: int, *, width: int) -> Meaning:
    if found == expected:
        return Meaning(f"{kind} OK")
    text = f"{kind} error: 0x{expected:0{width}X} expected, 0x{found:0{width}X} found"
    return Meaning(text, is_valid=False)


def _noise(data: bytes, why: str) -> Piece:
    return Piece(0, data, "noise", data.hex(" "), why, "frame", is_valid=False)
