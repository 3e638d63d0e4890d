"""Configurations of modpoll in CSV: rows of `device`, `poll` and `ref`; addresses as on the wire.

>>> from dissectors.importers.profile_builder import Options
>>> text = '''device,meter,1
... poll,input_register,30,4,BE_LE
... ref,power,32,float32,r,W
... '''
>>> read(text, "x.csv", Options()).model["registers"]
[{'at': 'ir:32', 'name': 'power', 'type': 'f32', 'order': 'CDAB', 'unit': 'W'}]
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from typing import Any

from dissectors.errors import ProfileError
from dissectors.importers.profile_builder import (
    Imported,
    NotConvertible,
    Options,
    ProfileBuilder,
    choose_unit,
    parse_decimal,
)

__all__ = ["read"]

_SPACES = {
    "coil": "co", "discrete_input": "di", "holding_register": "hr", "input_register": "ir",
}  # fmt: skip
_ORDERS = {"be_be": "ABCD", "le_be": "BADC", "le_le": "DCBA", "be_le": "CDAB"}
"""The bytes of a word, then the words."""

_KINDS = {
    "uint16": "u16", "int16": "s16", "uint32": "u32", "int32": "s32", "uint64": "u64",
    "int64": "s64", "float16": "f16", "float32": "f32", "float64": "f64",
}  # fmt: skip
_BOOLEANS = {"bool": 1, "bool8": 1, "bool16": 1}
_DEVICE_CELLS, _REF_CELLS = 3, 4


@dataclass(frozen=True, slots=True)
class _Poll:
    """What the rows below a `poll` share."""

    unit: int | None
    space: str
    order: str


@dataclass(frozen=True, slots=True)
class _Ref:
    """A row of a register: its line, name, and the cells from the address on."""

    line: int
    poll: _Poll | None
    name: str
    cells: list[str]


def read(text: str, name: str, options: Options) -> Imported:
    """Read the references; `ProfileError` where no row begins with `ref` below a `poll`."""
    builder = ProfileBuilder({"source": f"modpoll configuration {name}"}, options.order)
    refs = list(_refs(text, name, builder))
    if not any(ref.poll for ref in refs):
        raise ProfileError("no rows of `poll` with `ref` below them", path=name)
    builder.notes.append("addresses are as on the wire, as modpoll sends them")
    unit = choose_unit((ref.poll.unit for ref in refs if ref.poll), options.unit, name)
    for ref in refs:
        if ref.poll is None or ref.poll.unit in (unit, None):
            with builder.noting_failures(f"line {ref.line}, {ref.name}"):
                _add(builder, ref)
    return builder.build()


def _refs(text: str, name: str, builder: ProfileBuilder) -> list[_Ref]:
    """The rows of registers, each with the poll above it."""
    found: list[_Ref] = []
    unit: int | None = None
    poll: _Poll | None = None
    reader = csv.reader(text.splitlines())
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            word = cells[0].lower() if cells else ""
            if word == "device" and len(cells) >= _DEVICE_CELLS:
                unit, poll = _whole(cells[2]), None
            elif word == "poll":
                poll = _poll(cells[1:], unit)
                if poll is None:
                    builder.notes.append(f"line {reader.line_num}: no table is known; skipped")
            elif word == "ref" and len(cells) >= _REF_CELLS:
                found.append(_Ref(reader.line_num, poll, cells[1], _from_address(cells[2:])))
    except csv.Error as error:
        raise ProfileError(f"not CSV: {error}", path=name, line=reader.line_num) from None
    return found


def _poll(cells: list[str], unit: int | None) -> _Poll | None:
    """A poll: `type,start,size,order`, or formerly `device,unit,start,size,type,order`."""
    words = [cell.lower() for cell in cells]
    space = next((_SPACES[word] for word in words if word in _SPACES), None)
    order = next((_ORDERS[word] for word in words if word in _ORDERS), "CDAB")
    if space is None:
        return None
    former = words[0] not in _SPACES and len(words) > 1
    return _Poll(_whole(cells[1]) if former else unit, space, order)


def _from_address(cells: list[str]) -> list[str]:
    """The cells from the address on: formerly a unit of measure stood in front of it."""
    return cells if _whole(cells[0]) is not None else [*cells[1:4], cells[0], *cells[4:]]


def _whole(cell: str) -> int | None:
    number = parse_decimal(cell)
    return number if isinstance(number, int) else None


def _add(builder: ProfileBuilder, ref: _Ref) -> None:
    """Add the point of a row: address, type, access, unit, scale."""
    cells = [*ref.cells, "", "", "", ""]
    address, word = _whole(cells[0]), cells[1].lower()
    if ref.poll is None:
        raise NotConvertible("no poll of a known table is above it")
    if address is None:
        raise NotConvertible(f"{cells[0]!r} is not an address")
    scale = parse_decimal(cells[4])
    keys: dict[str, Any] = {
        "unit": cells[3],
        "access": _access(cells[2]),
        "scale": None if scale == 1 else scale,
    }
    space, order = ref.poll.space, ref.poll.order
    text = re.fullmatch(r"string(\d*)", word)
    if word in _BOOLEANS or space in ("co", "di"):
        if space in ("hr", "ir"):
            builder.note_once("bool: the bits of a register are kept as its number")
        builder.add(ref.name, space, address, **{**keys, "scale": None})
    elif text:
        builder.note_once("the length of a text counts registers (assumed)")
        builder.add(
            ref.name, space, address, type="str", count=int(text[1] or 2), order=order,
            unit=keys["unit"], access=keys["access"],
        )  # fmt: skip
    elif word in _KINDS:
        kind = _KINDS[word]
        builder.add(
            ref.name, space, address, type=None if kind == "u16" else kind, order=order, **keys
        )
    else:
        raise NotConvertible(f"type {cells[1]!r} is not known")


def _access(word: str) -> str | None:
    letters = word.lower()
    return letters if letters in ("w", "rw") else None
