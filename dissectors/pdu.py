"""PDUs decoded by the core, as typed objects, and the direction that a layout suggests.

>>> pdu = decode(bytes.fromhex("03 006B 0003"), "request")
>>> pdu.row.name, [(field.path, field.value) for field in pdu.fields]
('Read Holding Registers', [('address', 107), ('quantity', 3)])
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import _modlens
from dissectors.table import EXCEPTION_BIT, Direction, Function, row_of

__all__ = ["DecodedField", "Pdu", "decode", "default_functions", "guess_direction"]


@dataclass(frozen=True, slots=True)
class DecodedField:
    """A decoded field.

    `offset` counts from the function code; `path` says where in a group the field is, as
    `objects[0].value`. `value` is a number, a list of numbers (0 and 1 for bits), or bytes. A group
    is not a field itself, its fields are.
    """

    name: str
    path: str
    field_type: str
    offset: int
    length: int
    value: int | tuple[int, ...] | bytes


@dataclass(frozen=True, slots=True)
class Pdu:
    """A decoded PDU.

    `row` is None for a code that the table does not have; `exception` is the code of an exception
    response, else None. `fields` cover the bytes after the function code as far as the layout
    reaches; further bytes are a last field named "extra". `complete` is False where bytes are
    missing.
    """

    function: int
    row: Function | None
    exception: int | None
    complete: bool
    fields: tuple[DecodedField, ...]

    @property
    def numbers(self) -> dict[str, int]:
        """Name -> value of the fields that are single numbers outside groups."""
        return {f.path: f.value for f in self.fields if isinstance(f.value, int)}

    @property
    def is_valid(self) -> bool:
        """Whether the layout covers the bytes exactly and the table permits all values."""
        if not self.complete or any(part.name == "extra" for part in self.fields):
            return False
        return self.row is None or all(is_permitted(self.row, part) for part in self.fields)


def is_permitted(row: Function, part: DecodedField) -> bool:
    """Whether the table of functions permits the value of this field."""
    if not isinstance(part.value, int):
        return True
    low, high = row.limits.get(part.name, (0, 0xFFFF))
    return low <= part.value <= high and part.value in row.allowed.get(part.name, (part.value,))


_SHARED: list[_modlens.Functions] = []


def default_functions() -> _modlens.Functions:
    """The embedded table, compiled once; no rows are ever added to it."""
    if not _SHARED:
        _SHARED.append(_modlens.Functions())
    return _SHARED[0]


def decode(pdu: bytes, direction: Direction, *, functions: _modlens.Functions | None = None) -> Pdu:
    """Decode a PDU; never fails: of an incomplete PDU the fields that are there are given."""
    table = functions or default_functions()
    tree: dict[str, Any] = json.loads(table.decode(pdu, direction)) if pdu else {}
    fields = tuple(_parts(tree.get("fields") or (), pdu, prefix=""))
    code = pdu[0] & ~EXCEPTION_BIT if pdu else 0
    return Pdu(
        function=code,
        row=row_of(pdu, source=functions),
        exception=tree.get("exception"),
        complete=bool(tree.get("complete")),
        fields=fields,
    )


def guess_direction(
    pdu: bytes, *, functions: _modlens.Functions | None = None
) -> Literal["request", "response", "unknown"]:
    """The direction whose layout fits, or "unknown" where both or none fit.

    Only the frames around it can tell for certain: an echo (functions 5, 6 ...) has the same layout
    in both directions.

    >>> guess_direction(bytes.fromhex("03 006B 0003")), guess_direction(bytes.fromhex("83 02"))
    ('request', 'response')
    >>> guess_direction(bytes.fromhex("06 0001 0003"))
    'unknown'
    """
    if pdu and pdu[0] & EXCEPTION_BIT:
        return "response"
    fits_request = decode(pdu, "request", functions=functions).is_valid
    fits_response = decode(pdu, "response", functions=functions).is_valid
    if fits_request == fits_response:
        return "unknown"
    return "request" if fits_request else "response"


def _parts(nodes: Any, pdu: bytes, *, prefix: str) -> Iterator[DecodedField]:
    for node in nodes:
        path = f"{prefix}{node['name']}"
        if node["word"] == "group":
            for index, item in enumerate(node["children"]):
                yield from _parts(item, pdu, prefix=f"{path}[{index}].")
            continue
        offset, length = node["offset"], node["length"]
        raw = pdu[offset : offset + length]
        yield DecodedField(node["name"], path, node["word"], offset, length, _value(node, raw))


def _value(node: Any, raw: bytes) -> int | tuple[int, ...] | bytes:
    if node["word"] == "bytes":
        return raw
    found = node["value"]
    return int(found) if isinstance(found, int) else tuple(int(item) for item in found)
