"""Home Assistant's `modbus:` configuration, today's and that of 2021; addresses as on the wire.

`!include` and `!secret` are not followed: their values are left out, with a note.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from dissectors.errors import ProfileError
from dissectors.importers.homeassistant_hubs import Hub, hub_of
from dissectors.importers.profile_builder import (
    REGISTERS_OF_TYPE,
    Imported,
    NotConvertible,
    Options,
    ProfileBuilder,
    SeveralUnitsError,
    choose_unit,
    parse_decimal,
    parse_row_order,
)
from dissectors.importers.python_struct import points_of_structure
from dissectors.importers.unsupported_keys import UnsupportedKeys
from dissectors.profile import Profile
from dissectors.yaml import plain_data, tag_notes

__all__ = ["hubs", "read", "write"]

_LISTS = ("sensors", "binary_sensors", "switches", "lights", "fans", "covers", "climates")
_INPUTS = {
    "holding": "hr", "input": "ir", "coil": "co", "discrete_input": "di",
}  # fmt: skip
_KINDS = {
    "int16": "s16", "int32": "s32", "int64": "s64", "uint16": "u16", "uint32": "u32",
    "uint64": "u64", "float16": "f16", "float32": "f32", "float64": "f64", "string": "str",
}  # fmt: skip
_OLD = {"int": "s", "uint": "u", "float": "f"}
_KNOWN = {
    "name", "address", "register", "slave", "device_address", "input_type", "register_type",
    "write_type", "data_type", "count", "swap", "reverse_order", "scale", "offset",
    "unit_of_measurement", "structure", "nan_value", "virtual_count", "slave_count",
}  # fmt: skip
_READ_ONLY = ("sensors", "binary_sensors", "climates")
"""Of a climate, `address` is what it measures."""


@dataclass(frozen=True, slots=True)
class _Entity:
    """An entity of a hub: its unit, the list that it is in, its keys."""

    unit: int | None
    kind: str
    row: Mapping[str, Any]


def read(text: str, name: str, options: Options) -> Imported:
    """Read sensors, binary sensors, switches and so on; `ProfileError` where there are none."""
    data, tags = plain_data(text, name)
    builder = ProfileBuilder({"source": f"Home Assistant configuration {name}"}, options.order)
    builder.notes.append("addresses count from 0, as Home Assistant does")
    builder.notes += tag_notes(tags, "is not followed")
    entities = [found for hub in _hubs(data) for found in _entities(hub, builder)]
    if not entities:
        line, tag = tags[0] if tags else (None, "")
        hint = f"; {tag} is not followed: import that file" if tags else ""
        raise ProfileError(f"no modbus: with sensors or switches in it{hint}", path=name, line=line)
    unit = choose_unit((entity.unit for entity in entities), options.unit, name)
    if unit is not None and sum(unit in hub.units for hub in _buses(data)) > 1:
        # Two devices, on two lines: one profile would mix their registers.
        raise SeveralUnitsError(name, (unit,))
    for entity in entities:
        if entity.unit in (unit, None):
            with builder.noting_failures(entity.row.get("name", entity.row.get("address"))):
                _add(builder, entity)
    return builder.build()


def hubs(text: str, name: str) -> tuple[Hub, ...]:
    """The hubs that have entities, each with the units of these."""
    return _buses(plain_data(text, name)[0])


def _buses(data: Any) -> tuple[Hub, ...]:
    """The hubs; entities without one are those of a single bus, whose settings are unknown."""
    listed = list(_hubs(data))
    if not any(set(hub) & set(_LISTS) for hub in listed):
        return (Hub({"name": "bus"}, _units(listed), json.dumps(data, default=str)),)
    buses = (hub_of(hub, _units([hub]), number) for number, hub in enumerate(listed, 1))
    return tuple(bus for bus in buses if bus.units)


def _units(listed: list[Mapping[str, Any]]) -> tuple[int, ...]:
    builder = ProfileBuilder({}, None)
    found = {one.unit for hub in listed for one in _entities(hub, builder)}
    return tuple(sorted(unit for unit in found if unit is not None))


def _hubs(data: Any) -> Iterator[Mapping[str, Any]]:
    found = data.get("modbus", data) if isinstance(data, Mapping) else data
    listed = found if isinstance(found, list) else [found]
    yield from (hub for hub in listed if isinstance(hub, Mapping))


def _entities(hub: Mapping[str, Any], builder: ProfileBuilder) -> Iterator[_Entity]:
    """All entities of a hub, of a platform in the syntax of 2021, or of a list of entities."""
    for key in _LISTS:
        for row in _rows(hub.get(key)):
            yield _Entity(_unit(row), key, row)
    if hub.get("platform") == "modbus":
        for row in _rows(hub.get("registers") or hub.get("coils")):
            kind = "sensors" if "registers" in hub else "binary_sensors"
            yield _Entity(_unit(row), kind, row)
    elif "address" in hub and not set(hub) & set(_LISTS):
        builder.note_once("a list of entities without a hub: sensors (assumed)")
        yield _Entity(_unit(hub), "sensors", hub)


def _rows(listed: Any) -> Iterator[Mapping[str, Any]]:
    """The mappings in a list; anything else contains no entities."""
    if isinstance(listed, list):
        yield from (row for row in listed if isinstance(row, Mapping))


def _unit(row: Mapping[str, Any]) -> int | None:
    unit = row.get("slave", row.get("device_address"))
    return unit if isinstance(unit, int) and not isinstance(unit, bool) else None


def _add(builder: ProfileBuilder, entity: _Entity) -> None:
    """Add the point of an entity; of sensors on registers see `_add_sensor`."""
    row, kind = entity.row, entity.kind
    label = str(row.get("name", ""))
    address = row.get("address", row.get("register"))
    if not isinstance(address, int) or isinstance(address, bool):
        raise NotConvertible(
            "no address" if address is None else f"address {address!r} is not a number"
        )
    space = _space(row, kind)
    access = None if kind in _READ_ONLY else "rw"
    extra_values = row.get("virtual_count", row.get("slave_count"))
    more = 0 if extra_values is None else parse_decimal(extra_values)
    if not isinstance(more, int) or not 0 <= more < 0xFFFF:  # noqa: PLR2004 - registers there are
        raise NotConvertible(f"virtual_count {extra_values!r} is not a number of values")
    # Switches and other writable entities cannot have several values.
    known = _KNOWN if kind in _READ_ONLY else _KNOWN - {"virtual_count", "slave_count"}
    if space in ("co", "di"):
        count = more + 1 if more and kind in _READ_ONLY else None
        builder.add(label, space, address, access=access, count=count)
    elif kind == "binary_sensors":
        # A binary sensor on a register is the register's lowest bit.
        builder.add(label, space, address, part=(0, 0))
        known = known - {"virtual_count", "slave_count"}
    elif kind not in ("sensors", "climates"):
        labels = {key: parse_decimal(row.get(f"command_{key}")) for key in ("off", "on")}
        enum = {str(raw): key for key, raw in labels.items() if isinstance(raw, int)}
        known = known | {f"command_{key}" for key, raw in labels.items() if isinstance(raw, int)}
        builder.add(label, space, address, access=access, enum=enum)
    else:
        _add_sensor(builder, label, (space, address), row, more)
    builder.note_dropped(sorted(str(key) for key in set(row) - known))


def _space(row: Mapping[str, Any], kind: str) -> str:
    word = row.get("input_type") or row.get("register_type") or row.get("write_type")
    default = "coil" if kind == "binary_sensors" else "holding"
    space = _INPUTS.get(str(word or default).removesuffix("s"))
    if space is None:
        raise NotConvertible(f"input_type {word!r} is not known")
    return space


def _add_sensor(
    builder: ProfileBuilder, label: str, at: tuple[str, int], row: Mapping[str, Any], more: int
) -> None:
    """Add the point of a sensor on registers.

    `at` is its table and address; with `more` the sensor is an array of `more` + 1 values.
    """
    swap = parse_row_order(row.get("swap")) or ("CDAB" if row.get("reverse_order") else None)
    keys = {"unit": row.get("unit_of_measurement"), **_numbers(builder, label, row)}
    if row.get("data_type") == "custom":
        _add_structure(builder, label, at, row, {**keys, "order": swap})
        return
    kind, count = _type(row)
    if kind == "str" and (more or swap in ("CDAB", "DCBA")):
        raise NotConvertible("an array of texts" if more else "registers of a text in turned order")
    if more:
        count = REGISTERS_OF_TYPE[kind] * (more + 1)
    shown = None if kind == "u16" else kind
    builder.add(label, *at, type=shown, count=count, order=swap, **keys)


def _numbers(builder: ProfileBuilder, label: str, row: Mapping[str, Any]) -> dict[str, Any]:
    """Scale, offset and sentinel of a sensor, without those that change nothing."""
    numbers = {key: parse_decimal(row.get(key)) for key in ("scale", "offset", "nan_value")}
    for key, value in numbers.items():
        if value is None and row.get(key) is not None:
            builder.notes.append(f"{label}: {key} {row[key]!r} is not a number; skipped")
    scale, offset = numbers["scale"], numbers["offset"]
    return {
        "scale": None if scale in (1, 0) else scale,
        "offset": None if offset == 0 else offset,
        "nan": numbers["nan_value"],
    }


def _add_structure(
    builder: ProfileBuilder,
    label: str,
    at: tuple[str, int],
    row: Mapping[str, Any],
    keys: Mapping[str, Any],
) -> None:
    """Add a point for each run of equal values of a structure, named after its first value."""
    structure = str(row.get("structure", ""))
    if row.get("virtual_count", row.get("slave_count")):
        raise NotConvertible("an array of structures")
    registers, points = points_of_structure(structure, keys["order"])
    count = parse_decimal(row.get("count"))
    if count not in (None, registers):
        reason = f"structure {structure!r} takes {registers} registers, not the count of {count}"
        raise NotConvertible(reason)
    space, address = at
    for point in points:
        name = label if len(points) == 1 else f"{label}_{point.first_value}"
        shown = {
            "type": None if point.type == "u16" else point.type,
            "count": point.count,
            "order": point.order,
        }
        builder.add(name, space, address + point.register, **{**keys, **shown})
    if len(points) > 1:
        builder.notes.append(
            f"{label}: structure {structure!r} gives {len(points)} points, "
            "numbered by their first value"
        )


def _type(row: Mapping[str, Any]) -> tuple[str, int | None]:
    """The type of a sensor, and the registers of a text; `NotConvertible` for an unknown one."""
    word = str(row.get("data_type", "int16"))
    registers = parse_decimal(row.get("count"))
    count = registers if isinstance(registers, int) and registers > 0 else None
    if word == "string":
        return "str", count or 1
    if word in _KINDS:
        return _KINDS[word], None
    if word in _OLD:
        # Until 2021 `count` gave the width of a number in registers, one by default.
        kind = f"{_OLD[word]}{16 * (count or 1)}"
        if kind in REGISTERS_OF_TYPE:
            return kind, None
    raise NotConvertible(f"data type {word!r} is not understood")


_BACK = {kind: word for word, kind in _KINDS.items()}
_HALVES = {"u8h": ">Bx", "u8l": ">xB", "s8h": ">bx", "s8l": ">xb"}
_SWAPS = {"CDAB": "word", "BADC": "byte", "DCBA": "word_byte"}
_HUB = """\
modbus:
  - name: modbus
    type: serial
    port: /dev/ttyUSB0
    baudrate: 19200
    bytesize: 8
    method: rtu
    parity: E
    stopbits: 1
"""


def write(profile: Profile) -> tuple[str, list[str]]:
    """A hub with sensors and switches; what has no place in it, and what it assumes, are notes."""
    unsupported = UnsupportedKeys("Home Assistant")
    unsupported.device(profile)
    notes = ["port, line settings and slave: 1 are examples"]
    rows: dict[str, list[str]] = {"sensors": [], "binary_sensors": [], "switches": []}
    for point in profile.points:
        kind, keys = _entity(point, profile)
        if not kind:
            notes.append(f"{point['name']}: {point['type']} {point['at']} cannot be read; skipped")
            continue
        rows[kind] += [_item(one) for one in _each(keys)] if kind == "switches" else [_item(keys)]
        if kind == "switches" and "virtual_count" in keys:
            notes.append(f"{point['name']}: {point['count']} values, each of them a switch")
        lost = {"enum", "bits", "sf", "group", "note"}
        lost |= {"access"} if kind != "switches" or point["access"] == "w" else set()
        lost |= {"unit"} if kind != "sensors" else set()
        for key in point:
            if key in lost:
                unsupported.add(key, point["name"])
        if len(point.get("nan", ())) > 1:
            unsupported.add("the second value of nan", point["name"])
    lines = [_HUB.rstrip("\n")]
    for key, items in rows.items():
        if items:
            lines += [f"    {key}:", *items]
    return "\n".join(lines) + "\n", [*notes, *unsupported.notes()]


def _entity(point: Mapping[str, Any], profile: Profile) -> tuple[str, dict[str, Any]]:
    """In which list a point stands, and its keys; no list for what cannot be read."""
    space, _, place = point["at"].partition(":")
    address, _, bits = place.partition(".")
    table = {short: word for word, short in _INPUTS.items()}[space]
    keys: dict[str, Any] = {"name": point["name"], "address": int(address), "slave": 1}
    if space in ("co", "di"):
        writes = point.get("access", "r") != "r" and space == "co"
        keys["write_type" if writes else "input_type"] = table
        if point.get("count", 1) > 1:
            keys["virtual_count"] = point["count"] - 1
        return "switches" if writes else "binary_sensors", keys
    order = point.get("order", profile.device.get("order", "ABCD"))
    if bits == "0" and order in ("ABCD", "CDAB"):
        # Of a register, a binary sensor is the lowest bit.
        return "binary_sensors", {**keys, "input_type": table}
    # A structure names each value, and a swap would turn one half of a register into the other.
    is_half = point["type"] in _HALVES and point.get("count", 1) == 1 and order in ("ABCD", "CDAB")
    if bits or not (is_half or point["type"] in _BACK):
        return "", {}
    return "sensors", keys | _keys(point, order, table)


def _each(keys: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """A switch a coil: unlike sensors they have no `virtual_count`."""
    one = {key: value for key, value in keys.items() if key != "virtual_count"}
    more = keys.get("virtual_count")
    if more is None:
        yield one
        return
    for number in range(more + 1):
        yield {**one, "name": f"{one['name']}_{number}", "address": one["address"] + number}


def _keys(point: Mapping[str, Any], order: str, table: str) -> dict[str, Any]:
    """The keys of Home Assistant for a point of a profile, without its name and address.

    `table` is the input type; `order` is the order of the point's bytes and words.
    """
    kind = point["type"]
    keys: dict[str, Any] = {"input_type": table, "data_type": _BACK.get(kind, "custom")}
    if kind in _HALVES:
        keys |= {"count": 1, "structure": _HALVES[kind]}
    width = REGISTERS_OF_TYPE.get(kind)
    if kind == "str":
        keys["count"] = point["count"]
    elif width and point.get("count", width) != width:
        keys["virtual_count"] = point["count"] // width - 1
    if width in (None, 1):
        # In one register, and in a text, only the two bytes of each register can be swapped.
        order = {"CDAB": "ABCD", "DCBA": "BADC"}.get(order, order)
    if order in _SWAPS:
        keys["swap"] = _SWAPS[order]
    for key in ("scale", "offset"):
        if key in point:
            keys[key] = point[key]
    if "scale" in point or "offset" in point:
        keys["precision"] = max(_places(point.get(key, 0)) for key in ("scale", "offset"))
    if "unit" in point:
        keys["unit_of_measurement"] = point["unit"]
    if "nan" in point:
        keys["nan_value"] = point["nan"][0]
    return keys


def _places(number: float) -> int:
    """Decimal places.

    >>> _places(0.25), _places(1e-05), _places(10)
    (2, 5, 0)
    """
    exponent = Decimal(str(number)).as_tuple().exponent
    return max(-exponent, 0) if isinstance(exponent, int) else 0


def _item(keys: Mapping[str, Any]) -> str:
    # Strings and numbers in JSON are valid YAML.
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in keys.items()]
    return "      - " + "\n        ".join(lines)
