"""What was learned of a unit's registers as a table, what a person can settle first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from analyzer.counts import count_of
from analyzer.views.candidates import chance_text
from analyzer.views.screen import Part, Screen, fit, visible

__all__ = ["show_learned"]

_MOVING = ("measurement", "counter")
_LISTED = 12
"""So many addresses are listed of what is open."""

_COLUMNS = (("registers", 16), ("type", 11), ("role", 12), ("values", 24), ("unit", 10))

Points = Sequence[Mapping[str, Any]]


def show_learned(table: Mapping[str, Any], points: Points, source: str, screen: Screen) -> None:
    """Print a table of a unit: what is open, then a line for each value."""
    reads = sum(block["reads"] for block in table["blocks"])
    known = sum(one["role"] is not None for one in points)
    screen.line(
        f"unit {table['unit']}  {table['register_type'].replace('_', ' ')}s  "
        f"{count_of(reads, 'read')}, {known} of {count_of(len(points), 'value')} with a role",
        "head",
    )
    screen.lines(_open(table, points, source))
    heads = "".join(fit(name, width) for name, width in _COLUMNS)
    screen.line(f"  {heads}{'chance':>7}  why", "dim")
    screen.lines(_line(table["space"], one) for one in points if not _is_silent(one))


def _open(table: Mapping[str, Any], points: Points, source: str) -> Iterator[Sequence[Part]]:
    """What a value on a display settles, and what more traffic would."""
    space = table["space"]
    scales = [one for one in points if one["role"] in _MOVING and one["scale"] is None]
    if scales:
        yield [(f"  scale open: {space} {_addresses(scales)}", "note")]
        command = f"modlens learn {visible(source)} --value X --at TIME"
        yield [
            (f"    a value on a display settles its register, and others like it: {command}", "")
        ]
    roles = [one for one in points if one["role"] is None and not _is_silent(one)]
    still = [one for one in points if _is_silent(one)]
    for said, found in (("role open", roles), ("not seen to move", still)):
        if found:
            yield [(f"  {said}: {space} {_addresses(found)}", "note")]
    if roles or still:
        yield [("    longer or livelier traffic settles these", "")]


def _is_silent(one: Mapping[str, Any]) -> bool:
    """Whether nothing is said of a register that never moved."""
    return one["role"] is None and one["count"] == 1 and one["min"] == one["max"]


def _addresses(points: Points) -> str:
    texts = [_span(one) for one in points[:_LISTED]]
    more = len(points) - len(texts)
    return ", ".join(texts) + (f" and {more} more" if more else "")


def _span(one: Mapping[str, Any]) -> str:
    last = one["address"] + one["count"] - 1
    return str(last) if one["count"] == 1 else f"{one['address']}-{last}"


def _line(space: str, one: Mapping[str, Any]) -> Sequence[Part]:
    order = "" if one["count"] == 1 or one["type"] == "str" else f" {one['order']}"
    unit = one["unit_symbol"] or ("" if one["scale"] is None else f"x {one['scale']:g}")
    cells = (
        f"{space} {_span(one)}", f"{one['type']}{order}", one["role"] or "?", _values(one), unit,
    )  # fmt: skip
    parts: list[Part] = [("  ", "")]
    for text, (name, width) in zip(cells, _COLUMNS, strict=True):
        parts.append((fit(visible(text), width - 1) + " ", "dim" if name == "type" else ""))
    stated = [one[f"{name}_bits"] for name in ("role", "scale") if one[f"{name}_bits"] is not None]
    if one["layout_bits"] > 0:
        stated.append(one["layout_bits"])
    chance = chance_text(1 / (1 + 2 ** -min(stated))) if stated else ""
    parts.append((f"{chance:>7}", ""))
    reasons = [reason for reason in (one["scale_reason"], one["reason"]) if reason]
    parts.append((f"  {visible('; '.join(reasons))}", "dim"))
    return parts


def _values(one: Mapping[str, Any]) -> str:
    """The range of the values, scaled where the scale is known."""
    if one["min"] is None:
        return ""
    scale = one["scale"] or 1
    least, most = (f"{one[name] * scale:.6g}" for name in ("min", "max"))
    return least if least == most else f"{least} .. {most}"
