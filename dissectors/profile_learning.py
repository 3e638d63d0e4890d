"""What was learned of registers, as a profile, as JSON lines and as text.

The points are those of `_modlens.Survey.points`, in the order of their addresses.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

__all__ = ["answer_line", "evidence_lines", "point_of", "reason_lines"]

ANSWERS = (
    "unit", "register_type", "address", "count", "type", "order", "layout_bits", "role",
    "role_bits", "scale", "unit_symbol", "scale_bits", "quantity", "quantity_bits",
)  # fmt: skip
"""The keys of a line of `answer_line`."""


def answer_line(table: Mapping[str, Any], learned: Mapping[str, Any]) -> str:
    """What was learned of a point as a line of JSON; null where the data do not say."""
    row = {"unit": table["unit"], "register_type": table["register_type"], **learned}
    return json.dumps({key: row[key] for key in ANSWERS}) + "\n"


def point_of(table: Mapping[str, Any], learned: Mapping[str, Any]) -> dict[str, Any]:
    """The point of a profile, with type and order where they are certain."""
    if not learned.get("is_certain"):
        return {**_single_register(table, learned), **_scaled(learned, _looks(learned))}
    found = {**_address_keys(table, learned), "type": learned["type"]}
    if learned["type"] == "str":
        found["count"] = learned["count"]
    if learned["order"] != "ABCD":
        found["order"] = learned["order"]
    return {**found, **_scaled(learned, learned["reason"])}


def evidence_lines(table: Mapping[str, Any]) -> Iterator[str]:
    """The blocks of a table, and which registers change together, in lines of text."""
    head = f"unit {table['unit']} {table['space']}"
    blocks = ", ".join(_block(block) for block in table["blocks"])
    yield f"{head}: {table['registers']} addresses in {blocks}"
    for first, second in table["together"]:
        yield f"{head}: {first} and {second} change together"


def reason_lines(table: Mapping[str, Any], points: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Why points are what they are, in lines of text."""
    for learned in points:
        head = f"unit {table['unit']} {table['space']} {learned['address']}"
        if learned.get("is_certain"):
            yield (
                f"{head}: {learned['type']} {learned['order']} "
                f"(evidence {learned['layout_bits']:.0f} bits): {learned['reason']}"
            )
        if learned.get("unit_symbol") is not None:
            scale = f"{learned['unit_symbol']} x {learned['scale']:g}"
            role = learned["role"] or "role unknown"
            yield f"{head}: {role}, {scale}: {learned['scale_reason']}"


def _block(block: Mapping[str, Any]) -> str:
    last = block["first"] + block["count"] - 1
    words = [f"{block['reads']} reads"] if block["reads"] else []
    words += [f"{block['writes']} writes"] if block["writes"] else []
    words += [f"exception {code} {n} times" for code, n in block["exceptions"].items()]
    return f"{block['first']}-{last} ({', '.join(words)})"


def _single_register(table: Mapping[str, Any], learned: Mapping[str, Any]) -> dict[str, Any]:
    found = _address_keys(table, learned)
    if learned["looks"] == "signed":
        found["type"] = "s16"
    return found


def _looks(learned: Mapping[str, Any]) -> str:
    """What the values of a register look like."""
    if learned["looks"] == "enum":
        return f"one of {', '.join(map(str, learned['values']))}"
    if learned["looks"] == "constant":
        return f"constant {learned['raw_min']}"
    return f"{learned['looks']}, {learned['raw_min']} to {learned['raw_max']}"


def _scaled(learned: Mapping[str, Any], note: str) -> dict[str, Any]:
    """Scale and unit of a point, and its role in the note, where they are known."""
    found: dict[str, Any] = {}
    if learned.get("scale") not in (None, 1.0):
        found["scale"] = learned["scale"]
    if learned.get("unit_symbol") is not None:
        found["unit"] = learned["unit_symbol"]
        note = f"{note}; {learned['scale_reason']}"
    role = learned.get("role")
    if role is not None and role not in note:
        note = f"{note}; {role}"
    return {**found, "note": note}


def _address_keys(table: Mapping[str, Any], learned: Mapping[str, Any]) -> dict[str, Any]:
    space, address = table["space"], learned["address"]
    found = {"at": f"{space}:{address}", "name": f"{space}_{address}"}
    if learned["written"]:
        found["access"] = "rw" if learned["read"] else "w"
    return found
