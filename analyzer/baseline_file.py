"""Baselines: what is usual on the buses, as a TOML file that people read and edit.

A request is one line, so that a difference of two versions of the file is what a reviewer reads.

>>> text = dumps({"bus": [{"name": "line", "hours": 1.0, "request": [{"unit": 1, "function": 3}]}]})
>>> loads(text, "usual.toml")["bus"][0]["request"]
[{'unit': 1, 'function': 3}]
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from dissectors.errors import ProfileError

__all__ = ["dumps", "loads", "merge"]

_HEAD = """\
# What is usual on these buses, as modlens baseline found it. A request is a line:
# period_s        ranges of the time from one to the next, a pair for each phase (day, night ...)
# outcomes        how often it ended how
# response_time   how many were measured, and their deciles in seconds
# judged          what its registers are: setpoint (somebody writes it), state (it moves), constant
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


def merge(
    usual: Mapping[str, Any], seen: Mapping[str, Any], accepted: Iterable[Mapping[str, Any]]
) -> dict[str, Any]:
    """The baseline with what was seen, as far as accepted deviations are about it.

    `accepted` are the facts of findings. The requests that they name are added, or replaced by
    what was seen of them, or removed where nothing was; nothing else changes.
    """
    facts = list(accepted)
    buses = {bus["name"]: bus for bus in usual["bus"]}
    is_one_line = len(buses) == len(seen["bus"]) == 1
    new = {one["bus"] for one in facts if one["code"] == "new_bus"}
    gone = {one["bus"] for one in facts if one["code"] == "missing_bus"}
    merged = {name: bus for name, bus in buses.items() if name not in gone}
    for bus in seen["bus"]:
        name = next(iter(buses)) if is_one_line else bus["name"]
        if name in merged:
            keys = [one.get("requests", ()) for one in facts if one["bus"] == bus["name"]]
            wanted = {tuple(key) for some in keys for key in some}
            known = merged[name]
            merged[name] = {**known, "request": _requests(known["request"], bus["request"], wanted)}
        elif name in new:
            merged[name] = bus
    return {"bus": list(merged.values())}


def _requests(
    usual: list[dict[str, Any]], seen: list[dict[str, Any]], wanted: set[tuple[object, ...]]
) -> list[dict[str, Any]]:
    keys = ("client", "unit", "function", "writes", "address", "quantity")
    known = {tuple(row.get(key) for key in keys): row for row in usual}
    now = {tuple(row.get(key) for key in keys): row for row in seen}
    kept = {key: now.get(key) if key in wanted else row for key, row in known.items()}
    added = {key: row for key, row in now.items() if key in wanted and key not in known}
    return [row for row in (kept | added).values() if row is not None]
