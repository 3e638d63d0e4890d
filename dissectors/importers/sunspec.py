"""SunSpec information models (JSON): addresses count from the model's ID register.

Scale factors stay references (`sf`), "not implemented" values become `nan` (SunSpec Device
Information Model Specification, section 5.5 in the edition of 2021).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from dissectors.errors import ProfileError
from dissectors.importers.draft import Draft, Imported, Options

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

_BITFIELDS = ("bitfield16", "bitfield32", "bitfield64")


def read(text: str, name: str, options: Options) -> Imported:
    """The points of a model; repeated groups are left out, with a note."""
    try:
        model = json.loads(text)
        group, number = model["group"], int(model["id"])
    except (ValueError, KeyError, TypeError) as error:
        raise ProfileError(f"no SunSpec model: {error}", path=name) from None
    draft = Draft(
        {
            "id": f"sunspec.{number}",
            "vendor": "SunSpec Alliance",
            "model": f"{number} {group.get('label', group.get('name', ''))}".strip(),
            "source": f"SunSpec model {number}, JSON",
            "sunspec": number,
        }
    )
    at = 0
    for point in group.get("points", ()):
        at += _point(draft, point, at, group.get("name"))
    for inner in group.get("groups", ()):
        draft.dropped([f"group {inner.get('name')}"], "repeats as often as the device says")
    return draft.done()


def _point(draft: Draft, point: Mapping[str, Any], at: int, group: str | None) -> int:
    size = int(point.get("size", 1))
    kind, nan = _KINDS.get(point["type"], ("raw", None))
    if point["type"] not in _KINDS:
        draft.dropped([f"type {point['type']}"], "is not known, its registers are raw")
    if point["type"] == "pad":
        return size
    symbols = {
        str(symbol["value"]): symbol.get("label") or symbol["name"]
        for symbol in point.get("symbols", ())
    }
    scale = point.get("sf")
    draft.add(
        point["name"],
        "hr",
        at,
        type=kind,
        count=size if kind in ("str", "raw") else None,
        scale=10.0**scale if isinstance(scale, int) and scale < 0 else _power(scale),
        sf=scale if isinstance(scale, str) else None,
        unit=point.get("units"),
        access="rw" if point.get("access") == "RW" else None,
        enum=None if point["type"] in _BITFIELDS else symbols,
        bits=symbols if point["type"] in _BITFIELDS else None,
        nan=nan,
        group=group,
        note=point.get("label"),
    )
    return size


def _power(scale: object) -> int | None:
    return int(10**scale) if isinstance(scale, int) and scale > 0 else None
