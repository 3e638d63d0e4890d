"""Converts values that users give (numbers, lists, hex, objects) for the core's encoder.

>>> to_json(Field("registers", "u16[]"), "1, 0x0A")
[1, 10]
>>> to_json(Field("coils", "bits"), "1011")
[1, 0, 1, 1]
>>> to_json(Field("value", "bytes"), b"Hello")
'48656c6c6f'
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping

from dissectors.errors import UsageError
from dissectors.function_lookup import parse_number, similar_name
from dissectors.table import LIST_ITEM_BYTES, NUMBER_BYTES, Field

__all__ = ["Json", "coil_state", "to_json"]

Json = int | str | list["Json"] | dict[str, "Json"]

BIT_VALUES: Mapping[str, int] = {"on": 1, "off": 0, "true": 1, "false": 0}

COIL_STATES: Mapping[str, int] = {"on": 0xFF00, "off": 0x0000}
"""The two values of Write Single Coil (application protocol, 6.5)."""


def to_json(field: Field, value: object) -> Json:
    """Convert the value of a field for the core; `UsageError` says what the field takes."""
    if field.field_type == "group":
        return [_group(field, item) for item in _objects(field, value)]
    if field.field_type == "bytes":
        return _hex(field, value)
    if field.field_type == "bits":
        return [_bit(field, item) for item in _items(field, value)]
    if field.field_type in LIST_ITEM_BYTES:
        return [
            _number(field, item, LIST_ITEM_BYTES[field.field_type]) for item in _items(field, value)
        ]
    return _number(field, value, NUMBER_BYTES[field.field_type])


def coil_state(value: object) -> object:
    """Convert `on`, `off`, True or False to a coil's value; other values are returned unchanged.

    >>> coil_state("on"), coil_state(False), coil_state(1)
    (65280, 0, 1)
    """
    if isinstance(value, bool):
        value = "on" if value else "off"
    return COIL_STATES.get(value.casefold(), value) if isinstance(value, str) else value


def _number(field: Field, value: object, width: int) -> int:
    found = value if isinstance(value, int) else parse_number(str(value))
    highest = (1 << 8 * width) - 1
    if found is None or not 0 <= found <= highest:
        raise UsageError(f"{field.name} takes a number from 0 to {highest}, not {value!r}")
    return int(found)


def _bit(field: Field, value: object) -> int:
    found = BIT_VALUES.get(value.casefold(), value) if isinstance(value, str) else value
    if found in (0, 1, "0", "1"):
        return int(str(int(found)) if isinstance(found, int) else str(found))
    raise UsageError(f"{field.name} takes bits such as 1011 or on,off, not {value!r}")


def _items(field: Field, value: object) -> Iterable[object]:
    if isinstance(value, str):
        words = re.split(r"[,\s]+", value.strip()) if value.strip() else []
        packed = field.field_type == "bits" and len(words) == 1 and re.fullmatch("[01]+", words[0])
        return list(words[0]) if packed else words
    if isinstance(value, Iterable):
        return value
    if isinstance(value, int):
        return [value]
    raise UsageError(f"{field.name} takes a list of numbers, not {value!r}")


def _hex(field: Field, value: object) -> str:
    if isinstance(value, bytes | bytearray):
        return bytes(value).hex()
    try:
        return bytes.fromhex(str(value).removeprefix("0x")).hex()
    except ValueError:
        message = f"{field.name} takes bytes as hex, such as 48656C6C6F, not {value!r}"
        raise UsageError(message) from None


def _objects(field: Field, value: object) -> Iterable[Mapping[str, object]]:
    """The items of a group, from a list of mappings, one mapping, or JSON text."""
    if isinstance(value, str):
        try:
            value = json.loads(value)
        except json.JSONDecodeError as error:
            message = f"{field.name} takes a list of objects as JSON: {error.msg} at {error.colno}"
            raise UsageError(message) from None
    items = [value] if isinstance(value, Mapping) else value
    if isinstance(items, Iterable):
        found = list(items)
        if all(isinstance(item, Mapping) for item in found):
            return found
    raise UsageError(f"{field.name} takes a list of {{{_names(field)}}}, not {value!r}")


def _group(field: Field, item: Mapping[str, object]) -> dict[str, Json]:
    children = {child.name: child for child in field.children}
    for name in item:
        if name not in children:
            hint = similar_name(name, children)
            end = f"it takes {_names(field)}" if hint is None else f"did you mean {hint!r}?"
            raise UsageError(f"{field.name} has no field {name!r}; {end}")
    return {name: to_json(children[name], value) for name, value in item.items()}


def _names(field: Field) -> str:
    return ", ".join(child.name for child in field.children)
