"""scapy classes for PDUs: one for every row of the table and direction.

Imports scapy; see `dissectors.layers`.

>>> pdu = pdu_class("Read Coils", "request")(address=19, quantity=19)
>>> bytes(pdu).hex(" ")
'01 00 13 00 13'
"""

from __future__ import annotations

import re
import types
from collections.abc import Mapping
from typing import ClassVar, cast

from scapy.fields import AnyField, ByteEnumField
from scapy.packet import Packet

import _modlens
from dissectors import table, vocabulary
from dissectors.fields import build_fields, safe_name
from dissectors.pdu import guess_direction
from dissectors.table import DIRECTIONS, EXCEPTION_BIT, Direction, Function

__all__ = [
    "ModbusExceptionResponse",
    "ModbusPDU",
    "class_for",
    "load_vendor",
    "pdu_class",
    "pdu_classes",
]

_NAMED_FIELDS: Mapping[int, Mapping[str, vocabulary.Kind]] = {
    0x08: {"sub_function": "diagnostics"},
    0x2B: {
        "mei_type": "mei_types",
        "read_device_id_code": "read_device_id_codes",
        "conformity_level": "conformity_levels",
        "object_id": "object_ids",
    },
}
"""Function code -> field -> part of the vocabulary that has names for its values."""

_functions = _modlens.Functions()
"""The table that the layers are built from; `load_vendor` adds rows to it."""

_classes: dict[tuple[int, int | None, Direction], type[ModbusPDU]] = {}


def _exception_function_names() -> dict[int, str]:
    return {
        row.code | EXCEPTION_BIT: f"{row.name}, exception response" for row in table.functions()
    }


def _names_of(kind: vocabulary.Kind) -> dict[int, str]:
    return {entry.code: entry.name for entry in vocabulary.names(kind)}


class ModbusPDU(Packet):
    """A function code and its body; the base of the classes that the table gives."""

    name = "Modbus PDU"
    modbus_row: ClassVar[Function | None] = None


class ModbusExceptionResponse(ModbusPDU):
    """The function code with its highest bit set, and the exception code (section 7)."""

    name = "Modbus exception response"
    fields_desc: ClassVar[list[AnyField]] = [
        ByteEnumField("function", 0x80, _exception_function_names()),
        ByteEnumField("exception_code", 1, _names_of("exceptions")),
    ]


class _Group(Packet):
    """An item of a group; what follows it is the next item."""

    def extract_padding(self, s: bytes) -> tuple[bytes, bytes]:
        return b"", s


def pdu_class(
    function: int | str, direction: Direction, *, when: int | None = None
) -> type[ModbusPDU]:
    """The class of a function's request or response; `when` chooses a sub-function or MEI type.

    `KeyError` where the table has no such row or does not know its layout.

    >>> pdu_class(43, "request", when=14).__name__
    'ReadDeviceIdentificationRequest'
    """
    if isinstance(function, str):
        return pdu_classes()[f"{_camel(function)}{direction.capitalize()}"]
    return _classes.get((function, when, direction)) or _classes[function, None, direction]


def pdu_classes() -> Mapping[str, type[ModbusPDU]]:
    """All classes that the table gives, by name."""
    return {cls.__name__: cls for cls in _classes.values()}


def load_vendor(name: str) -> None:
    """Add a vendor's functions to the layers; `dissectors.vocabulary.vendors()` has the names."""
    _functions.load_vendor(name)
    _add(table.functions(_functions))


def _add(rows: tuple[Function, ...]) -> None:
    for row in rows:
        for direction in DIRECTIONS:
            if row.has_layout(direction):
                key = (row.code, row.when[1] if row.when else None, direction)
                _classes[key] = _pdu_class(row, direction)


def _pdu_class(row: Function, direction: Direction) -> type[ModbusPDU]:
    """Make the scapy class of one row and direction."""
    name = f"{_camel(row.label)}{direction.capitalize()}"
    code = ByteEnumField("function", row.code, {row.code: row.name})
    body = [_safe(field) for field in row.fields(direction)]
    fields = build_fields(
        body,
        derived=row.quantities(direction),
        defaults=_defaults(row),
        named=_names(row),
        group=lambda field: _group_class(row, name, field),
    )
    members = {
        "name": f"{row.label}, {direction}",
        "fields_desc": [code, *fields],
        "modbus_row": row,
        "__module__": __name__,
        "__doc__": f"{row.label}: the {direction}'s body (section {row.section}).",
    }
    made = types.new_class(name, (ModbusPDU,), exec_body=lambda space: space.update(members))
    return cast("type[ModbusPDU]", made)


def _group_class(row: Function, owner: str, field: table.Field) -> type[Packet]:
    """Make the scapy class of a group's item."""
    fields = build_fields(
        [_safe(child) for child in field.children],
        derived={},
        defaults=_defaults(row),
        named=_names(row),
        group=lambda child: _Group,
    )
    name = f"{owner}{_camel(field.name)}"
    members = {"name": field.name, "fields_desc": fields, "__module__": __name__}
    made = types.new_class(name, (_Group,), exec_body=lambda space: space.update(members))
    return cast("type[Packet]", made)


def _safe(field: table.Field) -> table.Field:
    return table.Field(safe_name(field.name), field.field_type, field.children)


def _camel(label: str) -> str:
    words = re.findall(r"[A-Za-z0-9]+", label)
    return "".join(word[:1].upper() + word[1:] for word in words)


def _defaults(row: Function) -> dict[str, int]:
    """Default values of a new packet: the lowest permitted, the first allowed, the row's own."""
    found = {name: low for name, (low, _) in row.limits.items()}
    found |= {name: values[0] for name, values in row.allowed.items()}
    return found | dict([row.when] if row.when else [])


def _names(row: Function) -> dict[str, dict[int, str]]:
    """Names of values, for the two functions that have some."""
    kinds = _NAMED_FIELDS.get(row.code, {}) if row.vendor is None else {}
    return {field: _names_of(kind) for field, kind in kinds.items()}


def class_for(pdu: bytes, direction: Direction | None) -> type[ModbusPDU] | None:
    """The class that decodes a PDU; None where the table has no layout.

    A direction of None is inferred from the layout.
    """
    if pdu[0] & EXCEPTION_BIT:
        return ModbusExceptionResponse
    if direction is None:
        guessed = guess_direction(pdu, functions=_functions)
        direction = "response" if guessed == "response" else "request"
    row = table.row_of(pdu, source=_functions)
    if row is None:
        return None
    return _classes.get((row.code, row.when[1] if row.when else None, direction))


_add(table.functions(_functions))
