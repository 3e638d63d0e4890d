"""SunSpec information models (JSON): addresses count from the model's ID register.

Scale factors stay references (`sf`), "not implemented" values become `nan` (SunSpec Device
Information Model Specification, section 5.5 in the edition of 2021).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from dissectors.errors import ProfileError
from dissectors.importers.profile_builder import Imported, Options, ProfileBuilder, parse_decimal

__all__ = ["read"]

_KINDS: Mapping[str, tuple[str, int | None]] = {
    "int16": ("s16", 0x8000), "uint16": ("u16", 0xFFFF), "count": ("u16", None),
    "acc16": ("u16", None), "enum16": ("u16", 0xFFFF), "bitfield16": ("u16", 0xFFFF),
    "pad": ("u16", 0x8000), "sunssf": ("s16", 0x8000), "raw16": ("u16", None),
    "int32": ("s32", 0x80000000), "uint32": ("u32", 0xFFFFFFFF), "acc32": ("u32", None),
    "enum32": ("u32", 0xFFFFFFFF), "bitfield32": ("u32", 0xFFFFFFFF),
    "int64": ("s64", 0x8000000000000000), "uint64": ("u64", 0xFFFFFFFFFFFFFFFF),
    "acc64": ("u64", None), "bitfield64": ("u64", 0xFFFFFFFFFFFFFFFF),
    "float32": ("f32", None), "float64": ("f64", None),
    "string": ("str", None), "ipaddr": ("raw", None), "ipv6addr": ("raw", None),
    "eui48": ("raw", None),
}  # fmt: skip

_MAX_SCALE_EXPONENT = 10
"""A scale factor is -10 to 10 (Device Information Model Specification, type `sunssf`)."""

_BITFIELDS = ("bitfield16", "bitfield32", "bitfield64")


_POINT = {"name", "type", "size", "sf", "units", "access", "symbols", "label"}
_GROUP = {"name", "type", "label", "points", "groups", "count"}


def read(text: str, name: str, _options: Options) -> Imported:
    """Read the points of a model; groups whose number only the device knows are left out."""
    try:
        model = json.loads(text.lstrip("\ufeff"))
        group, number = model["group"], int(model["id"])
        builder = ProfileBuilder(
            {
                "id": f"sunspec.{number}",
                "vendor": "SunSpec Alliance",
                "model": f"{number} {group.get('label', group.get('name', ''))}".strip(),
                "source": f"SunSpec model {number}, JSON",
                "sunspec": number,
            }
        )
        _group(builder, group, 0, "")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else error
        raise ProfileError(f"not a SunSpec model: {what}", path=name) from None
    return builder.build()


def _group(builder: ProfileBuilder, group: Mapping[str, Any], at: int, prefix: str) -> int | None:
    """Add the points of a group; gives the address after it, None where only the device knows."""
    builder.note_dropped(sorted(set(group) - _GROUP))
    names = {point["name"] for point in group.get("points", ())}
    for point in group.get("points", ()):
        at += _point(builder, point, at, (group.get("name"), prefix, names))
    for inner in group.get("groups", ()):
        label, count = str(inner.get("name")), inner.get("count", 1)
        if not isinstance(count, int) or not 1 <= count <= 0xFFFF:  # noqa: PLR2004 - registers
            builder.note_dropped(
                [f"group {label}, and what follows it"], "repeats as the device says"
            )
            return None
        for turn in range(count):
            inside = f"{prefix}{label}_" if count == 1 else f"{prefix}{label}_{turn + 1}_"
            behind = _group(builder, inner, at, inside)
            if behind is None:
                return None
            at = behind
    return at


def _point(
    builder: ProfileBuilder,
    point: Mapping[str, Any],
    at: int,
    where: tuple[str | None, str, set[str]],
) -> int:
    """Add a point at an address; gives the number of registers it takes.

    `where` has the group's name, the prefix of names, and the names in the group, among which a
    scale factor is looked up.
    """
    group, prefix, names = where
    size = int(point.get("size", 1))
    if size < 1:
        raise ValueError(f"size {size} of {point['name']}")
    kind, nan = _KINDS.get(point["type"], ("raw", None))
    if point["type"] not in _KINDS:
        builder.note_dropped([f"type {point['type']}"], "is not known, its registers are raw")
    if point["type"] == "pad":
        return size
    builder.note_dropped(sorted(set(point) - _POINT))
    symbols = {
        str(symbol["value"]): symbol.get("label") or symbol["name"]
        for symbol in point.get("symbols", ())
    }
    scale = point.get("sf")
    builder.add(
        prefix + point["name"],
        "hr",
        at,
        type=kind,
        count=size if kind in ("str", "raw") else None,
        scale=_power(scale),
        sf=(prefix if scale in names else "") + scale if isinstance(scale, str) else None,
        unit=point.get("units"),
        access="rw" if point.get("access") == "RW" else None,
        enum=None if point["type"] in _BITFIELDS else symbols,
        bits=symbols if point["type"] in _BITFIELDS else None,
        nan=nan,
        group=group,
        note=point.get("label"),
    )
    return size


def _power(scale: object) -> int | float | None:
    """The factor of a constant scale exponent, a whole number where possible."""
    if not isinstance(scale, int) or scale == 0 or abs(scale) > _MAX_SCALE_EXPONENT:
        return None
    return parse_decimal(10.0**scale)
