"""Home Assistant's `modbus:` configuration, today's and that of 2021; addresses as on the wire.

`!include` and `!secret` are not followed: their values are left out, with a note.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from dissectors.errors import ProfileError, UsageError
from dissectors.importers.draft import WIDTHS, Draft, Imported, Options, order_of, tidy
from dissectors.profile import Profile
from dissectors.yaml import plain_data

__all__ = ["read", "write"]

_LISTS = ("sensors", "binary_sensors", "switches", "lights", "fans", "covers", "climates")
_INPUTS = {
    "holding": "hr", "input": "ir", "coil": "co", "discrete_input": "di",
}  # fmt: skip
_KINDS = {
    "int16": "s16", "int32": "s32", "int64": "s64", "uint16": "u16", "uint32": "u32",
    "uint64": "u64", "float16": "f16", "float32": "f32", "float64": "f64", "string": "str",
}  # fmt: skip
_OLD = {"int": "s", "uint": "u", "float": "f"}
_STRUCT = {
    "h": "s16", "H": "u16", "i": "s32", "I": "u32", "l": "s32", "L": "u32", "q": "s64", "Q": "u64",
    "e": "f16", "f": "f32", "d": "f64", "b": "s8l", "B": "u8l",
}  # fmt: skip
_KNOWN = {
    "name", "address", "register", "slave", "device_address", "input_type", "register_type",
    "write_type", "data_type", "count", "swap", "reverse_order", "scale", "offset",
    "unit_of_measurement", "structure", "nan_value", "virtual_count", "slave_count", "platform",
}  # fmt: skip


def read(text: str, name: str, options: Options) -> Imported:
    """Sensors, binary sensors, switches and the like; `ProfileError` where there are none."""
    data, tags = plain_data(text, name)
    entities = [found for hub in _hubs(data) for found in _entities(hub)]
    if not entities:
        raise ProfileError("no modbus: with sensors or switches in it", path=name)
    units = sorted({unit for unit, *_ in entities if unit is not None})
    if options.unit is None and len(units) > 1:
        raise UsageError(f"{name}: units {', '.join(map(str, units))}; --unit N chooses one")
    unit = options.unit if options.unit is not None else next(iter(units), None)
    draft = Draft({"source": f"Home Assistant configuration {name}"})
    draft.notes.append("addresses count from 0, as Home Assistant does")
    draft.notes += [f"line {line}: {tag} is not followed; left out" for line, tag in tags]
    for own, kind, row in entities:
        if own in (unit, None):
            _add(draft, kind, row, options)
    return draft.done()


def _hubs(data: Any) -> Iterator[Any]:
    found = data.get("modbus", data) if isinstance(data, Mapping) else data
    yield from found if isinstance(found, list) else [found]


def _entities(hub: Any) -> Iterator[tuple[int | None, str, Mapping[str, Any]]]:
    """Unit, kind and keys of every entity of a hub, or of a platform of 2021."""
    if not isinstance(hub, Mapping):
        return
    for key in _LISTS:
        for row in _rows(hub.get(key)):
            yield _unit(row), key, row
    if hub.get("platform") == "modbus":
        for row in _rows(hub.get("registers") or hub.get("coils")):
            yield _unit(row), "sensors" if "registers" in hub else "binary_sensors", row


def _rows(listed: Any) -> Iterator[Mapping[str, Any]]:
    """The mappings of a list; anything else has no entities in it."""
    if isinstance(listed, list):
        yield from (row for row in listed if isinstance(row, Mapping))


def _unit(row: Mapping[str, Any]) -> int | None:
    unit = row.get("slave", row.get("device_address"))
    return unit if isinstance(unit, int) else None


def _add(draft: Draft, kind: str, row: Mapping[str, Any], options: Options) -> None:
    label = str(row.get("name", ""))
    draft.dropped(sorted(set(row) - _KNOWN))
    address = row.get("address", row.get("register"))
    if not isinstance(address, int):
        draft.notes.append(f"{label}: no address; left out")
        return
    default = {"sensors": "holding", "climates": "holding", "binary_sensors": "coil"}
    word = row.get("input_type") or row.get("register_type") or row.get("write_type")
    space = _INPUTS.get(str(word or default.get(kind, "holding")).removesuffix("s"), "hr")
    access = "rw" if kind not in ("sensors", "binary_sensors") else None
    if space in ("co", "di"):
        draft.add(label, space, address, access=access)
        return
    if kind not in ("sensors", "climates"):
        draft.add(label, space, address, access=access)
        return
    found = _type(row)
    if found is None:
        what = row.get("structure") or row.get("data_type")
        draft.notes.append(f"{label}: data type {what!r} is not understood; left out")
        return
    word_type, count, order = found
    swap = order_of(row.get("swap"), label) or ("CDAB" if row.get("reverse_order") else None)
    order = order or swap or options.order
    scale, offset = tidy(row.get("scale")), tidy(row.get("offset"))
    draft.add(
        label,
        space,
        address,
        type=None if word_type == "u16" else word_type,
        count=_length(row, word_type, count),
        order=None if order == "ABCD" else order,
        scale=None if scale in (1, 0) else scale,
        offset=None if offset == 0 else offset,
        unit=row.get("unit_of_measurement"),
        nan=tidy(row.get("nan_value")),
        access=access,
    )


def _length(row: Mapping[str, Any], kind: str, count: int | None) -> int | None:
    """Registers: of a text as many as are counted, of an array as many as its values take."""
    if kind == "str":
        return count or 1
    more = tidy(row.get("virtual_count", row.get("slave_count")))
    return WIDTHS[kind] * (int(more) + 1) if more else None


def _type(row: Mapping[str, Any]) -> tuple[str, int | None, str | None] | None:
    """Type, count and order of a sensor; None where it is not understood."""
    word = str(row.get("data_type", "int16"))
    told = tidy(row.get("count"))
    count = None if told is None else int(told)
    if word in _KINDS:
        return _KINDS[word], count, None
    if word in _OLD:
        kind = f"{_OLD[word]}{16 * (count or (2 if word == 'float' else 1))}"
        return (kind, None, None) if kind in WIDTHS else None
    match = re.fullmatch(r"([<>!=@]?)(\w)", str(row.get("structure", "")))
    if word == "custom" and match and match[2] in _STRUCT:
        kind = _STRUCT[match[2]]
        return kind, None, "DCBA" if match[1] == "<" else None
    return None


_BACK = {kind: word for word, kind in _KINDS.items()}
_SWAPS = {"CDAB": "word", "BADC": "byte", "DCBA": "word_byte"}


def write(profile: Profile) -> tuple[str, list[str]]:
    """A hub with sensors and switches; labels, bits and scale factors are left out."""
    notes: list[str] = []
    rows: dict[str, list[str]] = {"sensors": [], "binary_sensors": [], "switches": []}
    back = {short: word for word, short in _INPUTS.items()}
    for point in profile.points:
        for key in ("enum", "bits", "sf", "group", "note"):
            if key in point:
                notes.append(f"{point['name']}: {key} has no place in Home Assistant")
        space, _, place = point["at"].partition(":")
        if "." in place or (space in ("hr", "ir") and point["type"] not in _BACK):
            notes.append(f"{point['name']}: {point['type']} {point['at']} cannot be read; left out")
            continue
        keys: dict[str, Any] = {"name": point["name"], "address": int(place), "slave": 1}
        if space in ("co", "di"):
            writes = point.get("access") == "rw" and space == "co"
            keys["write_type" if writes else "input_type"] = back[space]
            rows["switches" if writes else "binary_sensors"].append(_item(keys))
            continue
        rows["sensors"].append(_item(keys | _keys(point, profile, back[space])))
    lines = ["modbus:", "  - name: modbus", "    type: serial", "    port: /dev/ttyUSB0"]
    lines += ["    baudrate: 19200", "    bytesize: 8", "    method: rtu", "    parity: E"]
    lines += ["    stopbits: 1"]
    notes.append("port and line settings are examples")
    for key, items in rows.items():
        if items:
            lines += [f"    {key}:", *items]
    return "\n".join(lines) + "\n", notes


def _keys(point: Mapping[str, Any], profile: Profile, table: str) -> dict[str, Any]:
    kind = point["type"]
    keys: dict[str, Any] = {"input_type": table, "data_type": _BACK[kind]}
    width = WIDTHS.get(kind)
    if kind == "str":
        keys["count"] = point["count"]
    elif width and point.get("count", width) != width:
        keys["virtual_count"] = point["count"] // width - 1
    order = point.get("order", profile.device.get("order", "ABCD"))
    if order in _SWAPS:
        keys["swap"] = _SWAPS[order]
    for key in ("scale", "offset"):
        if key in point:
            keys[key] = point[key]
    if "scale" in point or "offset" in point:
        keys["precision"] = max(
            len(str(point.get(key, 0)).partition(".")[2]) for key in ("scale", "offset")
        )
    if "unit" in point:
        keys["unit_of_measurement"] = point["unit"]
    if "nan" in point:
        keys["nan_value"] = point["nan"][0]
    return keys


def _item(keys: Mapping[str, Any]) -> str:
    # JSON's texts and numbers are YAML's.
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in keys.items()]
    return "      - " + "\n        ".join(lines)
