"""The canonical spelling of a profile.

>>> from dissectors.profile import shipped
>>> print(write(shipped("mightyzap"))[0].split("[[")[2].strip())
registers]]
at = "hr:208"
name = "goal_speed"
access = "rw"
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

from dissectors.profile import Profile

__all__ = ["dumps", "point_tables", "write"]

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def write(profile: Profile) -> tuple[str, list[str]]:
    """The TOML of a profile; nothing is lost."""
    return dumps(profile.model), []


def dumps(model: Mapping[str, Any]) -> str:
    """A model as TOML: the device, then a table a point; what is the default is left out."""
    lines = ["profile = 1", "", "[device]"]
    tables = {}
    for key, value in model["device"].items():
        if isinstance(value, Mapping):
            tables[key] = value
        else:
            lines.append(f"{key} = {_value(value)}")
    for key, table in tables.items():
        lines += ["", f"[device.{key}]"]
        lines += [f"{_key(name)} = {_value(text)}" for name, text in table.items()]
    return "\n".join(lines) + "\n" + point_tables(model["registers"])


def point_tables(points: Iterable[Mapping[str, Any]]) -> str:
    """Points as TOML, a table each; what is the default is left out."""
    lines = []
    for point in points:
        lines += ["", "[[registers]]"]
        default = "bool" if point["at"].startswith(("co", "di")) else "u16"
        for key, value in point.items():
            if (key, value) != ("type", default):
                lines.append(f"{key} = {_value(value)}")
    return "".join(f"{line}\n" for line in lines)


def _value(value: Any) -> str:
    """A value in TOML."""
    match value:
        case None:
            return "nan"  # JSON, which a model is, has no word for it
        case float():
            return repr(value)
        case int():
            return str(value)
        case list() | tuple():
            return f"[{', '.join(_value(item) for item in value)}]"
        case Mapping():
            inner = ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items())
            return f"{{ {inner} }}"
        case _:
            # TOML's basic strings are escaped as in JSON, except that DEL must be escaped as well.
            return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007F")


def _key(text: str) -> str:
    return text if _BARE.fullmatch(text) else json.dumps(text, ensure_ascii=False)
