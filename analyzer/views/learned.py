"""What was learned of a unit's registers as a table, what a person can settle first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from analyzer.counts import count_of
from analyzer.views.candidates import chance_text
from analyzer.views.screen import Part, Screen, fit, visible

__all__ = [
    "chance_of",
    "is_silent",
    "open_questions",
    "order_text",
    "show_learned",
    "span_text",
    "unit_text",
    "values_text",
]

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
    for what, registers, how in open_questions(points, source):
        screen.lines([[(f"  {what}: {table['space']} {registers}", "note")], [(f"    {how}", "")]])
    heads = "".join(fit(name, width) for name, width in _COLUMNS)
    screen.line(f"  {heads}{'chance':>7}  why", "dim")
    screen.lines(_line(table["space"], one) for one in points if not is_silent(one))


def open_questions(points: Points, source: str) -> Iterator[tuple[str, str, str]]:
    """What is open, of which registers, and what settles it: a value on a display, more traffic."""
    scales = [one for one in points if one["role"] in _MOVING and one["scale"] is None]
    if scales:
        command = f"modlens learn {visible(source)} --value X --at TIME"
        said = f"a value on a display settles its register, and others like it: {command}"
        yield "scale open", _addresses(scales), said
    roles = [one for one in points if one["role"] is None and not is_silent(one)]
    still = [one for one in points if is_silent(one)]
    for said, found in (("role open", roles), ("not seen to move", still)):
        if found:
            yield said, _addresses(found), "longer or livelier traffic"


def is_silent(one: Mapping[str, Any]) -> bool:
    """Whether a single register never moved, and holds nothing or nothing is said of it."""
    is_still = one["count"] == 1 and one["min"] == one["max"]
    return is_still and (one["role"] is None or (one["role"] == "constant" and not one["min"]))


def _addresses(points: Points) -> str:
    texts = [span_text(one) for one in points[:_LISTED]]
    more = len(points) - len(texts)
    return ", ".join(texts) + (f" and {more} more" if more else "")


def span_text(one: Mapping[str, Any]) -> str:
    """The addresses of a value, the first and the last."""
    last = one["address"] + one["count"] - 1
    return str(last) if one["count"] == 1 else f"{one['address']}-{last}"


def order_text(one: Mapping[str, Any]) -> str:
    """The order of a number of several registers, after a blank."""
    return "" if one["count"] == 1 or one["type"] == "str" else f" {one['order']}"


def unit_text(one: Mapping[str, Any]) -> str:
    """The unit of measure, or else the scale."""
    return one["unit_symbol"] or ("" if one["scale"] is None else f"x {one['scale']:g}")


def chance_of(one: Mapping[str, Any]) -> str:
    """The chance that all is right that is said of a value, as text."""
    stated = [one[f"{name}_bits"] for name in ("role", "scale") if one[f"{name}_bits"] is not None]
    if one["layout_bits"] > 0:
        stated.append(one["layout_bits"])
    return chance_text(1 / (1 + 2 ** -min(stated))) if stated else ""


def _line(space: str, one: Mapping[str, Any]) -> Sequence[Part]:
    cells = (
        f"{space} {span_text(one)}", f"{one['type']}{order_text(one)}", one["role"] or "?",
        values_text(one), unit_text(one),
    )  # fmt: skip
    parts: list[Part] = [("  ", "")]
    for text, (name, width) in zip(cells, _COLUMNS, strict=True):
        parts.append((fit(visible(text), width - 1) + " ", "dim" if name == "type" else ""))
    parts.append((f"{chance_of(one):>7}", ""))
    reasons = [reason for reason in (one["scale_reason"], one["reason"]) if reason]
    parts.append((f"  {visible('; '.join(reasons))}", "dim"))
    return parts


def values_text(one: Mapping[str, Any]) -> str:
    """The range of the values, scaled where the scale is known."""
    if one["min"] is None:
        return ""
    scale = one["scale"] or 1
    least, most = (f"{one[name] * scale:.6g}" for name in ("min", "max"))
    return least if least == most else f"{least} .. {most}"
