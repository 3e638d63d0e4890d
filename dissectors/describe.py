"""Describes one frame as a list of blocks: some bytes each, and their meaning.

The core decides which bytes are what; this is its answer as typed objects, for the views to draw.
The blocks cover the frame: joined, their bytes are the frame
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

from dataclasses import dataclass
from typing import Literal, cast

import _modlens
from dissectors.pdu import default_functions
from dissectors.table import Direction

__all__ = ["Layer", "Mode", "Piece", "describe", "has_checksum", "pdu_of"]

Mode = Literal["rtu", "ascii", "tcp", "pdu"]

Layer = Literal["frame", "mbap", "pdu", "checksum"]


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
    table = functions or default_functions()
    found = table.annotate(data, mode, direction, request, has_checksum)
    return [Piece(*piece[:5], cast("Layer", piece[5]), piece[6]) for piece in found]


def pdu_of(frame: bytes | None, mode: str, *, has_checksum: bool = True) -> bytes | None:
    """The PDU in a request's frame; None where there is no frame, or it is not decodable.

    >>> pdu_of(bytes.fromhex("01 03 00 6B 00 03 74 17"), "rtu").hex()
    '03006b0003'
    """
    return _modlens.pdu_of(frame, mode, has_checksum) if frame else None


def has_checksum(frame: bytes | None, mode: str, *, is_sound: bool) -> bool:
    """Whether a frame ends in its checksum, right or wrong.

    A sound frame that does not is one of a recording that prints none.

    >>> has_checksum(bytes.fromhex("01 03 00 6B 00 03"), "rtu", is_sound=True)
    False
    """
    return _modlens.has_checksum(frame or b"", mode, is_sound)
