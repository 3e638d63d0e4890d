"""Checks the arguments of a tool against its schema, in the words that an assistant can act on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dissectors.errors import UsageError

__all__ = ["check"]

_TYPES: dict[str, type[Any]] = {"string": str, "integer": int, "boolean": bool, "array": list}


def check(tool: str, arguments: Mapping[str, Any], schema: Mapping[str, Any]) -> None:
    """`UsageError` for an argument that is missing, unknown, or of the wrong kind.

    >>> check("rows", {"file": "a"}, {"properties": {"file": {"type": "string"}}})
    """
    known = schema["properties"]
    for name in schema.get("required", ()):
        if name not in arguments:
            raise UsageError(f"{tool}: the argument {name} is missing")
    for name, value in arguments.items():
        if name not in known:
            raise UsageError(f"{tool}: no argument {name!r}; there are {', '.join(known)}")
        trouble = _trouble(value, known[name])
        if trouble is not None:
            raise UsageError(f"{tool}: {name} {trouble}")


def _trouble(value: Any, schema: Mapping[str, Any]) -> str | None:
    """What is wrong with a value; None if it is as the schema wants it."""
    if "enum" in schema:
        return None if value in schema["enum"] else f"is one of {', '.join(schema['enum'])}"
    kind = schema["type"]
    if kind == "array" and isinstance(value, list):
        return next(filter(None, (_trouble(one, schema["items"]) for one in value)), None)
    if not isinstance(value, _TYPES[kind]) or (kind == "integer" and isinstance(value, bool)):
        return f"has to be of type {kind}"
    if kind == "integer" and value < schema.get("minimum", value):
        return f"is {schema['minimum']} or more"
    if kind == "integer" and value > schema.get("maximum", value):
        return f"is {schema['maximum']} or less"
    return None
