"""Baselines: what is usual on the buses, as a TOML file that people read and edit.

A request is one line, so that a difference of two versions of the file is what a reviewer reads.

>>> text = dumps({"bus": [{"name": "line", "hours": 1.0, "request": [{"unit": 1, "function": 3}]}]})
>>> loads(text, "usual.toml")["bus"][0]["request"]
[{'unit': 1, 'function': 3}]
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

from dissectors.errors import ProfileError

__all__ = ["dumps", "loads", "merge"]

_HEAD = """\
# What is usual on these buses, as modlens baseline found it. A request is a line:
# period_s        ranges of the time from one to the next, a pair for each phase (day, night ...)
# outcomes        how often it ended how
# response_time   how many were measured, and their deciles in seconds
# values          of each register: number of changes, then its values, or lowest, highest, "range"
# Delete a line to have its request reported; modlens security --accept adds lines.
format = 1
"""


def dumps(usage: Mapping[str, Any]) -> str:
    """The file for what `Watch.usage` returns."""
    return _HEAD + "".join(f"\n[[bus]]\n{_bus(bus)}" for bus in usage["bus"])


def _bus(bus: Mapping[str, Any]) -> str:
    head = "".join(
        f"{key} = {_value(value)}\n"
        for key, value in bus.items()
        if key != "request" and value is not None
    )
    rows = "".join(f"  {_value(row)},\n" for row in bus["request"])
    return f"{head}request = [\n{rows}]\n"


def _value(value: object) -> str:
    """A value of JSON in TOML, on one line."""
    if isinstance(value, dict):
        pairs = (f"{_key(key)} = {_value(item)}" for key, item in value.items())
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=True)


def _key(key: str) -> str:
    return key if key.replace("_", "").isalnum() and key.isascii() else json.dumps(key)


def loads(text: str, path: str) -> dict[str, Any]:
    """Read a baseline; `ProfileError` if it is none."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(str(error), path=path) from error
    if table.get("format") != 1 or not isinstance(table.get("bus"), list):
        raise ProfileError(
            "not a baseline: it begins with format = 1 and has [[bus]] rows (modlens baseline)",
            path=path,
        )
    return table


def merge(usual: Mapping[str, Any], seen: Mapping[str, Any], codes: set[str]) -> dict[str, Any]:
    """The baseline with what was seen, as far as findings with these codes are about it.

    Codes that begin with `new_` and `value_never_written` add requests and values of `seen`;
    `missing_request` and `missing_bus` take away what `seen` lacks; all others replace what is
    known of a request by what was seen of it.
    """
    buses = {bus["name"]: bus for bus in usual["bus"]}
    is_one_line = len(buses) == len(seen["bus"]) == 1
    merged = []
    for bus in seen["bus"]:
        known = next(iter(buses.values())) if is_one_line else buses.get(bus["name"])
        if known is not None:
            merged.append({**known, "request": _requests(known["request"], bus["request"], codes)})
        elif "new_bus" in codes:
            merged.append(bus)
    names = {bus["name"] for bus in merged}
    kept = [bus for name, bus in buses.items() if name not in names]
    return {"bus": merged if "missing_bus" in codes else [*kept, *merged]}


def _requests(
    usual: list[dict[str, Any]], seen: list[dict[str, Any]], codes: set[str]
) -> list[dict[str, Any]]:
    keys = ("client", "unit", "function", "writes", "address", "quantity")
    known = {tuple(row.get(key) for key in keys): row for row in usual}
    now = {tuple(row.get(key) for key in keys): row for row in seen}
    adds = {
        "new_client",
        "new_writer",
        "new_unit",
        "new_function",
        "new_request",
        "new_write_range",
    }
    replaces = codes - adds - {"missing_request", "new_bus", "missing_bus"}
    merged = {
        key: now[key] if key in now and replaces else row
        for key, row in known.items()
        if key in now or "missing_request" not in codes
    }
    if codes & adds:
        merged |= {key: row for key, row in now.items() if key not in known}
    return list(merged.values())
