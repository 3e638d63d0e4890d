"""Inverter definitions of Home Assistant's solarman integrations; addresses as on the wire.

An item lists its registers with the one of the lowest 16 bits first, so the list gives the order.

>>> from dissectors.importers.profile_builder import Options
>>> text = '''
... requests: [{start: 0x10, end: 0x20, mb_functioncode: 4}]
... parameters:
...   - group: grid
...     items:
...       - {name: energy, rule: 3, registers: [0x11, 0x10], scale: 0.1, uom: kWh}
... '''
>>> read(text, "x.yaml", Options()).model["registers"]
[{'at': 'ir:16', 'name': 'energy', 'type': 'u32', 'scale': 0.1, 'unit': 'kWh', 'group': 'grid'}]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dissectors.errors import ProfileError
from dissectors.importers.profile_builder import (
    Imported,
    NotConvertible,
    Options,
    ProfileBuilder,
    parse_decimal,
)
from dissectors.yaml import plain_data, tag_notes

__all__ = ["read"]

_NUMBERS = {1: "u", 2: "s", 3: "u", 4: "s"}
"""Rules of numbers -> unsigned or signed; how wide they are follows from the registers."""

_TEXT, _BITS, _TIME = 5, 6, 9
_PARTS = {7: "version", 8: "date and time", 10: "list of registers"}
"""Rules that give several parts of a register or more -> what they are."""

_SPACES = {3: "hr", 4: "ir"}
_KNOWN = {
    "name", "registers", "rule", "scale", "divide", "offset", "uom", "unit_of_measurement",
    "lookup", "mask", "code",
}  # fmt: skip
_DISPLAY = {
    "class", "state_class", "icon", "isstr", "friendly_name", "device_class", "platform",
    "description", "update_interval", "suggested_display_precision", "alt", "hidden",
    "configurable", "validation", "attributes", "attribute", "persistent", "mppt", "l", "digits",
}  # fmt: skip
"""Keys that say how a value is shown, and nothing of registers."""
_WRITTEN = ("number", "select", "switch", "button", "time", "datetime")
"""Platforms of Home Assistant whose entities are written."""


def read(text: str, name: str, options: Options) -> Imported:
    """Read the items of a definition; `ProfileError` where there are none."""
    data, tags = plain_data(text, name)
    groups = data.get("parameters") if isinstance(data, Mapping) else None
    items = list(_items(groups))
    if not items:
        raise ProfileError("no parameters: with groups of items in it", path=name)
    source = {"source": f"solarman inverter definition {name}"}
    builder = ProfileBuilder(_maker(data) | source, options.order)
    builder.notes.append("addresses are as on the wire; the list of registers gives the order")
    builder.notes += tag_notes(tags, "is not followed")
    for group, item in items:
        label = item.get("name", "an item without name")
        with builder.noting_failures(label):
            _add(builder, group, item, _space(data, item))
    return builder.build()


def _maker(data: Mapping[str, Any]) -> dict[str, str]:
    """Vendor and model, where the definition says them; a model may be a list of several."""
    info = data.get("info")
    said = info if isinstance(info, Mapping) else {}
    listed = {"vendor": said.get("manufacturer"), "model": said.get("model")}
    texts = {
        key: ", ".join(map(str, value)) if isinstance(value, list) else str(value or "")
        for key, value in listed.items()
    }
    return {key: text for key, text in texts.items() if text}


def _items(groups: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for group in groups if isinstance(groups, list) else []:
        items = group.get("items") if isinstance(group, Mapping) else None
        for item in items if isinstance(items, list) else []:
            if isinstance(item, Mapping):
                yield str(group.get("group", "")), item


def _registers(item: Mapping[str, Any]) -> list[int]:
    """The registers of an item, that of the lowest bits first."""
    listed = item.get("registers")
    if not listed and "sensors" in item:
        raise NotConvertible("calculated from registers of other items")
    if not isinstance(listed, list) or not listed:
        raise NotConvertible("no registers")
    found = [parse_decimal(place) for place in listed]
    if not all(isinstance(place, int) for place in found):
        raise NotConvertible(f"registers {listed!r} are not addresses")
    return [place for place in found if isinstance(place, int)]


def _space(data: Mapping[str, Any], item: Mapping[str, Any]) -> str:
    """The table of an item: of its own function code, or of the request that reads it."""
    listed = item.get("registers")
    first = parse_decimal(listed[0]) if isinstance(listed, list) and listed else None
    codes = [_code(item.get("code"))]
    requests = data.get("requests")
    for request in requests if isinstance(requests, list) else []:
        if isinstance(request, Mapping) and isinstance(first, int):
            start, end = parse_decimal(request.get("start")), parse_decimal(request.get("end"))
            if start is not None and end is not None and start <= first <= end:
                codes.append(_code(request.get("mb_functioncode", request.get("code"))))
    default = data.get("default")
    if isinstance(default, Mapping):
        codes.append(_code(default.get("code")))
    return next((_SPACES[code] for code in codes if code in _SPACES), "hr")


def _code(value: Any) -> Any:
    """The function code that reads, of a number or of `{read: 3, write: 16}`."""
    number = parse_decimal(value.get("read") if isinstance(value, Mapping) else value)
    return number if isinstance(number, int) else None


def _add(builder: ProfileBuilder, group: str, item: Mapping[str, Any], space: str) -> None:
    registers, rule = _registers(item), parse_decimal(item.get("rule", 1))
    name = str(item.get("name", ""))
    keys: dict[str, Any] = {
        "group": group,
        "unit": item.get("uom") or item.get("unit_of_measurement"),
        "access": "rw" if item.get("platform") in _WRITTEN and space == "hr" else None,
    }
    dropped = set(item) - _KNOWN - _DISPLAY
    if rule in _NUMBERS:
        first, part = _number(item, registers, _NUMBERS[int(rule)], keys)
        builder.add(name, space, first, part=part, **keys)
    else:
        _add_other(builder, (name, space), rule, registers, keys)
        dropped |= {key for key in ("scale", "divide", "offset", "lookup", "mask") if item.get(key)
                    not in (None, 1, [])}  # fmt: skip
    builder.note_dropped(sorted(str(key) for key in dropped))


def _number(
    item: Mapping[str, Any], registers: list[int], sign: str, keys: dict[str, Any]
) -> tuple[int, tuple[int, int] | None]:
    """First register and bits of a number; its type, order, scale and labels go into `keys`."""
    first, order = _place(registers)
    kind = f"{sign}{16 * len(registers)}"
    if len(registers) not in (1, 2, 4):
        raise NotConvertible(f"a number of {len(registers)} registers")
    keys["type"], keys["order"] = None if kind == "u16" else kind, order
    scale, offset = _scale_and_offset(item)
    keys["scale"], keys["offset"] = scale, offset
    keys["enum"] = _labels(item.get("lookup"))
    mask = item.get("mask")
    return first, None if mask is None else _bits(parse_decimal(mask), len(registers), keys)


def _place(registers: list[int]) -> tuple[int, str]:
    """The lowest address, and the order of the words: the list begins with the lowest bits."""
    first, last = registers[0], registers[-1]
    step = 1 if last >= first else -1
    if registers != list(range(first, last + step, step)):
        raise NotConvertible(f"registers {registers} are not neighbours")
    return min(first, last), "CDAB" if step > 0 and len(registers) > 1 else "ABCD"


def _scale_and_offset(item: Mapping[str, Any]) -> tuple[int | float | None, int | float | None]:
    """Scale and offset: the integration takes the offset off before it scales."""
    scale, divide = parse_decimal(item.get("scale", 1)), parse_decimal(item.get("divide", 1))
    offset = parse_decimal(item.get("offset", 0))
    if scale in (None, 0) or divide in (None, 0) or offset is None:
        raise NotConvertible("scale or offset is not a number")
    factor = parse_decimal(round(float(scale or 1) / float(divide or 1), 12))
    shift = parse_decimal(round(-float(offset) * float(factor or 1), 12))
    return None if factor == 1 else factor, None if shift == 0 else shift


def _labels(lookup: Any) -> dict[str, str]:
    """The labels of a lookup by raw value; one of its rows may have several keys."""
    labels: dict[str, str] = {}
    for row in lookup if isinstance(lookup, list) else []:
        if isinstance(row, Mapping):
            raw = row.get("key", row.get("bit"))
            for key in raw if isinstance(raw, list) else [raw]:
                number = parse_decimal(key)
                if isinstance(number, int) and row.get("value") is not None:
                    labels[str(number)] = str(row["value"])
    return labels


def _bits(mask: int | float | None, width: int, keys: dict[str, Any]) -> tuple[int, int] | None:
    """The bits that a mask leaves; None for all of them."""
    everything = (1 << 16 * width) - 1
    if mask == everything:
        return None
    if not isinstance(mask, int) or width > 1 or not 0 < mask < everything:
        raise NotConvertible(f"mask {mask!r} is not one of a register")
    low, high = (mask & -mask).bit_length() - 1, mask.bit_length() - 1
    if mask != (1 << high + 1) - (1 << low):
        raise NotConvertible(f"mask {mask:#06x} is not a contiguous run of bits")
    # The mask does not shift: a label of the masked value is one of the bits alone after it.
    keys["enum"] = {str(int(raw) >> low): text for raw, text in keys["enum"].items()}
    if low and (keys["scale"] or keys["offset"]):
        raise NotConvertible("a mask with a scale")
    if low and not keys["enum"]:
        keys["scale"] = 1 << low
    return low, high


def _add_other(
    builder: ProfileBuilder,
    at: tuple[str, str],
    rule: int | float | None,
    registers: list[int],
    keys: dict[str, Any],
) -> None:
    """Add what is no number: a text, bits, a time of day; `at` is its name and table."""
    if rule == _BITS:
        registers = sorted(registers)
    first, last = registers[0], registers[-1]
    if rule not in (_TEXT, _BITS, _TIME, *_PARTS):
        raise NotConvertible(f"rule {rule!r} is not known")
    if registers != list(range(first, last + 1)):
        raise NotConvertible(f"registers {registers} are not neighbours in rising order")
    count = len(registers)
    if rule == _TEXT:
        builder.add(*at, first, type="str", count=count, **keys)
        return
    if rule == _TIME and count == 1:
        builder.add(*at, first, note="time of day as hours * 100 + minutes", **keys)
        return
    what = _PARTS.get(int(rule or 0), "bit field")
    builder.note_once(f"{what}: kept as registers without conversion")
    builder.add(*at, first, count=count if count > 1 else None, note=what, **keys)
