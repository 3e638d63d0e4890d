"""Templates and configurations of wb-mqtt-serial (JSON with comments); addresses as on the wire.

Written from the driver's documentation. The templates that come with the driver are licensed for
its maker's controllers only; whoever imports one sees to that.

>>> from dissectors.importers.profile_builder import Options
>>> text = '''{"device": {"channels": [  // a remark
...   {"name": "Level", "reg_type": "holding", "address": "109:1:2", "readonly": true}
... ]}}'''
>>> read(text, "x.json", Options()).model["registers"]
[{'at': 'hr:109.1-2', 'name': 'Level'}]
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
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
    "holding": "hr", "holding_single": "hr", "holding_multi": "hr", "input": "ir", "coil": "co",
    "discrete": "di",
}  # fmt: skip
_KINDS = {
    "u16": "u16", "s16": "s16", "u8": "u8l", "s8": "s8l", "u32": "u32", "s32": "s32", "u64": "u64",
    "s64": "s64", "float": "f32", "double": "f64", "bcd16": "bcd16", "bcd32": "bcd32",
}  # fmt: skip
_WIDTHS = {"u8": 0xFF, "s8": 0xFF, "u16": 0xFFFF, "s16": 0xFFFF, "u32": 0xFFFF_FFFF,
           "s32": 0xFFFF_FFFF}  # fmt: skip
_DROPPED = ("condition", "consists_of", "write_address")
_UNITS = {
    "temperature": "°C", "rel_humidity": "%", "atmospheric_pressure": "mbar", "rainfall": "mm/h",
    "wind_speed": "m/s", "power": "W", "power_consumption": "kWh", "voltage": "V",
    "water_flow": "m³/h", "water_consumption": "m³", "resistance": "Ohm", "concentration": "ppm",
    "heat_power": "Gcal/h", "heat_energy": "Gcal", "current": "A", "pressure": "bar", "lux": "lx",
    "sound_level": "dB",
}  # fmt: skip
"""Type of a control -> its unit, in which its values are unless `units` says another."""
_COMMENT_OR_TEXT = re.compile(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
_TRAILING_COMMA = re.compile(r'("(?:\\.|[^"\\])*")|,(?=\s*[}\]])')
_ADDRESS = re.compile(r"(0x[0-9a-f]{1,16}|\d{1,20})(?::(\d{1,9})(?::(\d{1,9}))?)?", re.IGNORECASE)
_LICENCE = "templates that come with wb-mqtt-serial are licensed for Wiren Board controllers only"

Row = Mapping[str, Any]


def read(text: str, name: str, options: Options) -> Imported:
    """Read channels and parameters; `ProfileError` where there are none."""
    data = _data(text, name)
    rows = list(_rows(data))
    device = data.get("device") if isinstance(data, Mapping) else None
    protocol = str(device.get("protocol", "modbus")) if isinstance(device, Mapping) else "modbus"
    if not protocol.startswith("modbus"):
        raise ProfileError(f"protocol {protocol}, not Modbus", path=name)
    if not rows:
        raise ProfileError("no device with channels or parameters in it", path=name)
    model = str(device.get("name") or "") if isinstance(device, Mapping) else ""
    source = {"model": model} if model else {}
    source["source"] = f"wb-mqtt-serial template {name}"
    builder = ProfileBuilder(source, options.order)
    builder.notes += ["addresses are as on the wire, as the driver sends them", _LICENCE]
    unit = choose_unit((found for found, _, _ in rows), options.unit, name)
    for found, row, is_parameter in rows:
        if found in (unit, None):
            label = row.get("name") or row.get("title") or row.get("id") or "no name"
            with builder.noting_failures(label):
                _add(builder, str(label), row, is_parameter=is_parameter)
    return builder.build()


def _data(text: str, name: str) -> Any:
    """The JSON of a text without its comments."""
    if "{%" in text or "{{" in text:
        raise ProfileError("a Jinja template: import what the driver makes of it", path=name)
    plain = _COMMENT_OR_TEXT.sub(lambda found: found[0] if found[0][0] == '"' else " ", text)
    plain = _TRAILING_COMMA.sub(lambda found: found[1] or "", plain.lstrip("\ufeff"))
    try:
        return json.loads(plain)
    except (ValueError, RecursionError) as error:
        line = getattr(error, "lineno", None)
        what = getattr(error, "msg", "nested too deeply")
        raise ProfileError(f"not JSON: {what}", path=name, line=line) from None


def _rows(data: Any) -> Iterator[tuple[int | None, Row, bool]]:
    """Unit, row, and whether it is a parameter, of a template or of a configuration with ports."""
    if not isinstance(data, Mapping):
        return
    for port in _list(data.get("ports")):
        for device in _list(port.get("devices")):
            yield from _of_device(device)
    template = data.get("device")
    if isinstance(template, Mapping):
        yield from _of_device(template)
    for one in _list(data.get("devices")):
        yield from _of_device(one)


def _of_device(device: Row) -> Iterator[tuple[int | None, Row, bool]]:
    unit = parse_decimal(device.get("slave_id"))
    unit = unit if isinstance(unit, int) else None
    for row in _list(device.get("channels")):
        for one in _list(row.get("consists_of")) or [row]:
            yield unit, one, False
    parameters = device.get("parameters")
    listed: list[Row]
    if isinstance(parameters, Mapping):
        listed = [{"id": key, **row} for key, row in parameters.items() if isinstance(row, Mapping)]
    else:
        listed = _list(parameters)
    for row in listed:
        yield unit, row, True
    for one in _list(device.get("subdevices")):
        inner = one.get("device", one)
        if isinstance(inner, Mapping):
            yield from _of_device(inner)


def _list(value: Any) -> list[Row]:
    listed = value if isinstance(value, list) else []
    return [row for row in listed if isinstance(row, Mapping)]


def _add(builder: ProfileBuilder, label: str, row: Row, *, is_parameter: bool) -> None:
    word = str(row.get("reg_type", "holding"))
    space = _SPACES.get(word)
    if space is None:
        raise NotConvertible(f"reg_type {word!r} is not known")
    address, part, access = _place(row, space)
    form = str(row.get("format", "u16"))
    keys: dict[str, Any] = {
        "unit": row.get("units") or _UNITS.get(str(row.get("type"))),
        "access": access,
        "group": row.get("group"),
        "enum": _labels(row),
    }
    builder.note_dropped(key for key in _DROPPED if row.get(key) is not None)
    if space in ("co", "di"):
        builder.add(label, space, address, **keys)
        return
    keys["order"] = "CDAB" if row.get("word_order") == "little_endian" else "ABCD"
    if form in ("string", "char8"):
        size = parse_decimal(row.get("string_data_size", 1))
        if not isinstance(size, int):
            raise NotConvertible("a string without string_data_size")
        keys |= {"type": "strl", "count": size}
    else:
        keys |= _number(row, form)
        if is_parameter and row.get("offset") not in (None, 0):
            keys["offset"] = None
            builder.note_dropped(["offset of a parameter"])
    if part is not None:
        keys["type"] = keys["order"] = None
    builder.add(label, space, address, part=part, **keys)


def _place(row: Row, space: str) -> tuple[int, tuple[int, int] | None, str | None]:
    """Address, bits and access; a row that has only an address to write to is written."""
    written = row.get("address") is None and row.get("write_address") is not None
    text = str(row.get("write_address") if written else row.get("address", "")).strip()
    match = _ADDRESS.fullmatch(text)
    if match is None:
        raise NotConvertible(f"address {text!r} is not understood" if text else "no address")
    address = int(match[1], 16 if match[1][:2].lower() == "0x" else 10)
    access = "w" if written else None
    if not written and space in ("hr", "co") and row.get("readonly") is not True:
        access = "rw"
    if match[2] is None:
        return address, None, access
    low = int(match[2])
    high = low + int(match[3] or 1) - 1
    if not low <= high <= 15:  # noqa: PLR2004 - the bits of a register
        raise NotConvertible(f"bits {text!r} are not those of one register")
    return address, (low, high), access


def _number(row: Row, form: str) -> dict[str, Any]:
    """Type, scale, offset and the values that mean none."""
    kind = _KINDS.get(form)
    if kind is None:
        raise NotConvertible(f"format {form!r} is not known")
    scale, offset = parse_decimal(row.get("scale")), parse_decimal(row.get("offset"))
    nan = [parse_decimal(row.get(key)) for key in ("error_value", "unsupported_value")]
    raws = [_signed(raw, form) for raw in nan if isinstance(raw, int)]
    return {
        "type": None if kind == "u16" else kind,
        "scale": None if scale in (1, 0) else scale,
        "offset": None if offset == 0 else offset,
        "nan": list(dict.fromkeys(raws)),
    }


def _signed(raw: int, form: str) -> int:
    """A raw value as its type counts: 0xFFFF of an s16 is -1."""
    most = _WIDTHS.get(form)
    return raw - most - 1 if form[0] == "s" and most is not None and raw > most // 2 else raw


def _labels(row: Row) -> dict[str, str]:
    """The titles of an enumeration by raw value, or of a switch whose values are not 0 and 1."""
    raws, titles = row.get("enum"), row.get("enum_titles")
    if raws is None and row.get("on_value") is not None:
        raws, titles = [row.get("off_value", 0), row["on_value"]], ["off", "on"]
    if not isinstance(raws, list) or not isinstance(titles, list):
        return {}
    pairs = zip(raws, titles, strict=False)
    numbers = ((parse_decimal(raw), title) for raw, title in pairs)
    return {str(raw): str(title) for raw, title in numbers if isinstance(raw, int)}
