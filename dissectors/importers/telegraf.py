"""Telegraf's `inputs.modbus`: styles `register`, `request`, `metric`; addresses as on the wire.

`FIXED` and `UFIXED` are whole numbers with a scale, of as many registers as the addresses name.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from dissectors import toml
from dissectors.errors import ProfileError
from dissectors.importers.profile_builder import (
    REGISTERS_OF_TYPE,
    Imported,
    NotConvertible,
    Options,
    ProfileBuilder,
    choose_unit,
    parse_decimal,
    parse_row_order,
)
from dissectors.importers.unsupported_keys import UnsupportedKeys
from dissectors.profile import Profile

__all__ = ["read", "write"]

_STYLES = {
    "coils": "co",
    "discrete_inputs": "di",
    "holding_registers": "hr",
    "input_registers": "ir",
}
_TABLES = {"coil": "co", "discrete": "di", "holding": "hr", "input": "ir"}
_KINDS = {
    "BIT": "bool", "INT8L": "s8l", "INT8H": "s8h", "UINT8L": "u8l", "UINT8H": "u8h",
    "INT16": "s16", "UINT16": "u16", "INT32": "s32", "UINT32": "u32", "INT64": "s64",
    "UINT64": "u64", "FLOAT16": "f16", "FLOAT32": "f32", "FLOAT64": "f64", "STRING": "str",
}  # fmt: skip
_FIXED = {1: "16", 2: "32", 4: "64"}
_HALVES = {"lower": "strl", "upper": "strh"}
_FIELD = {
    "name", "address", "byte_order", "data_type", "type", "bit", "length", "scale", "register",
    "omit",
}  # fmt: skip
_REQUEST = {"slave_id", "byte_order", "register", "fields"}
_PLUGIN = {
    *_STYLES, "request", "metric", "slave_id", "configuration_type", "string_register_location",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Field:
    """A field with what its request and its plugin add: unit, table, order, type of texts."""

    unit: int | None
    space: str
    order: Any
    texts: str
    row: Mapping[str, Any]


def read(text: str, name: str, options: Options) -> Imported:
    """Read the fields of a configuration; `ProfileError` where it has no inputs.modbus."""
    tree: Any = toml.load(text.lstrip("\ufeff"), name)
    inputs = _table(tree.get("inputs")).get("modbus")
    plugins = _tables(inputs if isinstance(inputs, list) else [inputs])
    if not plugins:
        raise ProfileError("no [[inputs.modbus]] in it", path=name)
    builder = ProfileBuilder({"source": f"Telegraf configuration {name}"}, options.order)
    builder.notes.append("addresses count from 0, as Telegraf does")
    fields = [found for plugin in plugins for found in _fields(plugin, builder)]
    unit = choose_unit((field.unit for field in fields), options.unit, name)
    for field in fields:
        if field.unit in (unit, None):
            with builder.noting_failures(field.row.get("name", field.row.get("address"))):
                _add(builder, field)
    return builder.build()


def _table(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _tables(value: Any) -> list[Mapping[str, Any]]:
    """The tables in a list; anything else contains no fields."""
    rows = value if isinstance(value, list) else []
    return [row for row in rows if isinstance(row, Mapping)]


def _fields(plugin: Mapping[str, Any], builder: ProfileBuilder) -> Iterator[_Field]:
    """All fields in all three styles; other keys of plugin and requests are noted as dropped."""
    builder.note_dropped(sorted(set(plugin) - _PLUGIN), "is not part of a register map")
    where = plugin.get("string_register_location", "")
    texts = _HALVES.get(where if isinstance(where, str) else "", "str")
    for key, space in _STYLES.items():
        for one in _tables(plugin.get(key)):
            yield _Field(_unit(plugin), space, None, texts, one)
    for style in ("request", "metric"):
        for request in _tables(plugin.get(style)):
            builder.note_dropped(
                sorted(set(request) - _REQUEST), f"of a {style} cannot be kept in a profile"
            )
            for one in _tables(request.get("fields")):
                # In the style `metric` each field names its table, in the style `request` the
                # request does.
                table_name = str(
                    (request if style == "request" else one).get("register", "holding")
                )
                unit = _unit(request)
                yield _Field(
                    unit, _TABLES.get(table_name, table_name), request.get("byte_order"), texts, one
                )


def _unit(row: Mapping[str, Any]) -> int | None:
    unit = row.get("slave_id")
    return unit if isinstance(unit, int) else None


def _add(builder: ProfileBuilder, field: _Field) -> None:
    """Add the point of a field; `NotConvertible` says why that is not possible."""
    row, space = field.row, field.space
    if row.get("omit"):
        raise NotConvertible("omit = true")
    if space not in _TABLES.values():
        raise NotConvertible(f"table {space!r} is not known")
    builder.note_dropped(sorted(set(row) - _FIELD))
    label = str(row.get("name", ""))
    first, width = _registers(row)
    if space in ("co", "di"):
        builder.add(label, space, first)
        return
    kind = _kind(row, width)
    bit = row.get("bit", 0)
    if kind == "bool" and (type(bit) is not int or bit not in range(16)):
        raise NotConvertible(f"bit {bit!r} is not one of 0 to 15")
    if isinstance(row["address"], list) and REGISTERS_OF_TYPE.get(kind, width) != width:
        raise NotConvertible(f"{_word(row)} takes {REGISTERS_OF_TYPE[kind]} registers, not {width}")
    length = parse_decimal(row.get("length", width))
    if kind == "str" and not (isinstance(length, int) and length > 0):
        raise NotConvertible(f"length {row['length']!r} is not a number of registers")
    builder.add(
        label,
        space,
        first,
        part=(bit, bit) if kind == "bool" else None,
        type=None if kind == "bool" else field.texts if kind == "str" else kind,
        count=length if kind == "str" else None,
        order=parse_row_order(row.get("byte_order", field.order)),
        scale=_scale(row),
    )


def _registers(row: Mapping[str, Any]) -> tuple[int, int]:
    """The first register and their number; `NotConvertible` where they are not consecutive."""
    addresses = row.get("address")
    listed = [
        one
        for one in (addresses if isinstance(addresses, list) else [addresses])
        if isinstance(one, int) and not isinstance(one, bool)
    ]
    if not listed:
        raise NotConvertible(
            "no address" if not addresses else f"address {addresses!r} is not a number"
        )
    first = listed[0]
    if isinstance(addresses, list) and addresses != list(range(first, first + len(addresses))):
        raise NotConvertible(f"registers {addresses} are not in a row")
    return first, len(listed)


def _word(row: Mapping[str, Any]) -> str:
    return str(row.get("data_type", row.get("type", "UINT16"))).upper()


def _kind(row: Mapping[str, Any], width: int) -> str:
    """The type of a profile; fixed-point numbers are integers with a scale."""
    word = _word(row)
    if word in ("FIXED", "UFIXED") or (word == "FLOAT32" and "data_type" in row):
        # FLOAT32 without -IEEE is the old name of UFIXED in the style with data_type.
        if width not in _FIXED:
            raise NotConvertible(f"{word} of {width} registers")
        return ("s" if word == "FIXED" else "u") + _FIXED[width]
    kind = _KINDS.get(word.removesuffix("-IEEE"))
    if kind is None:
        raise NotConvertible(f"type {word} is not known")
    return kind


def _scale(row: Mapping[str, Any]) -> int | float | None:
    scale = parse_decimal(row.get("scale"))
    if scale is None and "scale" in row:
        raise NotConvertible(f"scale {row['scale']!r} is not a number")
    return None if scale in (1, 0) else scale


_WORD_OF_TYPE = {kind: word for word, kind in _KINDS.items()}
_UNSUPPORTED = ("enum", "bits", "nan", "sf", "offset", "unit", "access", "group", "note")


def write(profile: Profile) -> tuple[str, list[str]]:
    """Write a configuration in the style `request`; what it cannot hold or assumes is noted."""
    unsupported = UnsupportedKeys("Telegraf")
    unsupported.device(profile)
    notes = ["slave_id = 1 is an example"]
    tables: dict[str, list[str]] = {}
    for point in profile.points:
        space, _, place = point["at"].partition(":")
        kind = "bool" if "." in place and "-" not in place else point["type"]
        if (kind not in _WORD_OF_TYPE and space in ("hr", "ir")) or "-" in place:
            notes.append(
                f"{point['name']}: {kind} {point['at']} cannot be read by Telegraf; skipped"
            )
            continue
        for key in _UNSUPPORTED:
            if key in point:
                unsupported.add(key, point["name"])
        rows = list(_fields_of(point, kind))
        if len(rows) > 1:
            notes.append(f"{point['name']}: {len(rows)} values, each of them a field")
        key = f"{space} {point.get('order', profile.device.get('order', 'ABCD'))}"
        tables.setdefault(key, []).extend(rows)
    lines = ["[[inputs.modbus]]", 'name = "modbus"', 'configuration_type = "request"']
    back = {short: word for word, short in _TABLES.items()}
    for key, rows in tables.items():
        space, order = key.split()
        lines += ["", "  [[inputs.modbus.request]]", "  slave_id = 1", f'  byte_order = "{order}"']
        lines += [f'  register = "{back[space]}"', "  fields = [", *rows, "  ]"]
    return "\n".join(lines) + "\n", [*notes, *unsupported.notes()]


def _fields_of(point: Mapping[str, Any], kind: str) -> Iterator[str]:
    """The fields of a point: one, or one for each value of an array."""
    space, _, place = point["at"].partition(":")
    address, _, bit = place.partition(".")
    for suffix, offset in _elements(point):
        words = [f"address = {int(address) + offset}", f"name = {_text(point['name'] + suffix)}"]
        if space in ("hr", "ir"):
            words.append(f"type = {_text(_WORD_OF_TYPE[kind])}")
            if bit:
                words.append(f"bit = {bit}")
            if kind == "str":
                words.append(f"length = {point['count']}")
            if "scale" in point:
                words.append(f"scale = {float(point['scale'])!r}")
        yield f"    {{ {', '.join(words)} }},"


def _elements(point: Mapping[str, Any]) -> Iterator[tuple[str, int]]:
    """For each value of an array the suffix of its name, and the offset of its first register."""
    width = REGISTERS_OF_TYPE.get(point["type"])
    count = point.get("count", width)
    if width is None or count == width:
        yield "", 0
        return
    for number in range(count // width):
        yield f"_{number}", number * width


def _text(text: str) -> str:
    # TOML's basic strings are escaped as in JSON, except that DEL must be escaped as well.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")
