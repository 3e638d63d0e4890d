"""Telegraf's `inputs.modbus`: styles `register`, `request`, `metric`; addresses as on the wire.

`FIXED` and `UFIXED` are whole numbers with a scale, of as many registers as the addresses name.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from dissectors.errors import ProfileError, UsageError
from dissectors.importers.draft import WIDTHS, Draft, Imported, Options, order_of, tidy
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
_KNOWN = {
    "name", "address", "byte_order", "data_type", "type", "bit", "length", "scale", "register",
}  # fmt: skip


def read(text: str, name: str, options: Options) -> Imported:
    """The fields of a configuration; `ProfileError` where it is no TOML or has no inputs.modbus."""
    try:
        inputs = tomllib.loads(text).get("inputs", {}).get("modbus", [])
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(f"no TOML: {error}", path=name) from None
    if not inputs:
        raise ProfileError("no [[inputs.modbus]] in it", path=name)
    fields = [found for row in inputs for found in _fields(row)]
    units = sorted({unit for unit, *_ in fields if unit is not None})
    if options.unit is None and len(units) > 1:
        raise UsageError(f"{name}: units {', '.join(map(str, units))}; --unit N chooses one")
    unit = options.unit if options.unit is not None else next(iter(units), None)
    draft = Draft({"source": f"Telegraf configuration {name}"})
    draft.notes.append("addresses count from 0, as Telegraf does")
    for own, space, order, row in fields:
        if own in (unit, None):
            _add(draft, space, row, order_of(row.get("byte_order", order), name) or options.order)
    return draft.done()


def _fields(row: Mapping[str, Any]) -> Iterator[tuple[int | None, str, Any, Mapping[str, Any]]]:
    """Unit, table, order and keys of every field, in all three styles."""
    for key, space in _STYLES.items():
        for one in row.get(key, ()):
            yield row.get("slave_id"), space, None, one
    for request in row.get("request", ()):
        table = _TABLES.get(request.get("register", "holding"), "hr")
        for one in request.get("fields", ()):
            yield request.get("slave_id"), table, request.get("byte_order"), one
    for metric in row.get("metric", ()):
        for one in metric.get("fields", ()):
            table = _TABLES.get(one.get("register", "holding"), "hr")
            yield metric.get("slave_id"), table, metric.get("byte_order"), one


def _add(draft: Draft, space: str, row: Mapping[str, Any], order: str | None) -> None:
    if row.get("omit"):
        draft.notes.append(f"{row.get('name', row.get('address'))}: omit = true; left out")
        return
    draft.dropped(sorted(set(row) - _KNOWN - {"omit", "output", "measurement", "tags"}))
    draft.dropped(key for key in ("output", "measurement", "tags") if key in row)
    label = str(row.get("name", ""))
    addresses = row.get("address", 0)
    addresses = addresses if isinstance(addresses, list) else [addresses]
    first, width = int(addresses[0]), len(addresses)
    if addresses != list(range(first, first + width)):
        draft.notes.append(f"{label}: registers {addresses} are not in a row; left out")
        return
    if space in ("co", "di"):
        draft.add(label, space, first)
        return
    word = str(row.get("data_type", row.get("type", "UINT16"))).upper()
    kind = _KINDS.get(word.removesuffix("-IEEE"))
    if word in ("FIXED", "UFIXED") or (word == "FLOAT32" and "data_type" in row):
        # FLOAT32 without -IEEE is the old name of UFIXED in the style with data_type.
        kind = ("s" if word == "FIXED" else "u") + _FIXED.get(width, "?")
    if kind is None or kind.endswith("?"):
        draft.notes.append(f"{label}: type {word} of {width} registers; left out")
        return
    bit = row.get("bit")
    count = int(row.get("length", width)) if kind == "str" else None
    plain_order = order if order != "ABCD" and kind != "bool" else None
    draft.add(
        label,
        space,
        first,
        part=(int(bit or 0), int(bit or 0)) if kind == "bool" else None,
        type=None if kind == "bool" else kind,
        count=count,
        order=plain_order,
        scale=_scale(row),
    )


def _scale(row: Mapping[str, Any]) -> int | float | None:
    scale = tidy(row.get("scale"))
    return None if scale in (1, 0) else scale


_BACK = {
    **{kind: word for word, kind in _KINDS.items()}, "bool": "BIT",
}  # fmt: skip


def write(profile: Profile) -> tuple[str, list[str]]:
    """A `request` style configuration; labels, sentinels and scale factors are left out."""
    notes: list[str] = []
    tables: dict[str, list[str]] = {}
    for point in profile.points:
        space, _, place = point["at"].partition(":")
        address, _, bits = place.partition(".")
        kind = point["type"]
        for key in ("enum", "bits", "nan", "sf", "offset", "unit", "group", "note"):
            if key in point:
                notes.append(f"{point['name']}: {key} has no place in Telegraf")
        if (kind not in _BACK and space in ("hr", "ir")) or "-" in bits:
            notes.append(
                f"{point['name']}: {kind} {point['at']} cannot be read by Telegraf; left out"
            )
            continue
        for suffix, offset in _elements(point):
            words = [
                f"address = {int(address) + offset}",
                f"name = {_text(point['name'] + suffix)}",
            ]
            if space in ("hr", "ir"):
                words.append(f"type = {_text(_BACK[kind])}")
                if bits:
                    words.append(f"bit = {bits}")
                if kind == "str":
                    words.append(f"length = {point['count']}")
                if "scale" in point:
                    words.append(f"scale = {float(point['scale'])!r}")
            key = f"{space} {point.get('order', profile.device.get('order', 'ABCD'))}"
            tables.setdefault(key, []).append(f"    {{ {', '.join(words)} }},")
    lines = ["[[inputs.modbus]]", 'name = "modbus"', 'configuration_type = "request"']
    back = {short: word for word, short in _TABLES.items()}
    for key, rows in tables.items():
        space, order = key.split()
        lines += ["", "  [[inputs.modbus.request]]", "  slave_id = 1", f'  byte_order = "{order}"']
        lines += [f'  register = "{back[space]}"', "  fields = [", *rows, "  ]"]
    return "\n".join(lines) + "\n", notes


def _elements(point: Mapping[str, Any]) -> Iterator[tuple[str, int]]:
    """The values of an array, each with what goes behind the name, and its first register."""
    width = WIDTHS.get(point["type"])
    count = point.get("count", width)
    if width is None or count == width:
        yield "", 0
        return
    for number in range(count // width):
        yield f"_{number}", number * width


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
