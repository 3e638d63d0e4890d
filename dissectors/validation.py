"""What is wrong with a number in a PDU: limits, lengths, reach, echoes."""

from __future__ import annotations

from dissectors.context import LAST_ADDRESS, Context
from dissectors.pdu import Part
from dissectors.table import LISTS, Function

__all__ = ["doubts"]


def doubts(part: Part, value: int, context: Context) -> tuple[str, ...]:
    """What is wrong with a number, each in a few words; empty if nothing is."""
    row = context.row
    if row is None or context.pdu.exception is not None:
        return ()
    found = (
        _limit(part, value, row),
        _announced(part, value, context),
        _reach(part, value, context),
        _echo(part, value, context, row),
    )
    return tuple(text for text in found if text)


def _limit(part: Part, value: int, row: Function) -> str:
    low, high = row.limits.get(part.name, (value, value))
    if not low <= value <= high:
        return f"the specification permits {low} to {high}"
    allowed = row.allowed.get(part.name)
    if allowed is not None and value not in allowed:
        shown = " or ".join(f"0x{item:0{2 * part.length}X}" for item in allowed)
        return f"the specification permits {shown}"
    return ""


def _announced(part: Part, value: int, context: Context) -> str:
    """A length of the whole body against what follows and against the quantity."""
    follow = context.following(part) if part.word.startswith("len") else None
    if follow is None:
        return ""
    if value != follow:
        return "too few" if follow < value else "too many"
    lists = [item for item in context.pdu.fields if item.word == "bits" or item.word in LISTS]
    quantity = context.block(lists[0].name)[2] if len(lists) == 1 else None
    if quantity is None:
        return ""
    needed = -(-quantity // 8) if lists[0].word == "bits" else quantity * LISTS[lists[0].word]
    return "" if needed == value else f"but a quantity of {quantity} takes {needed}"


def _reach(part: Part, value: int, context: Context) -> str:
    if not part.name.endswith("quantity"):
        return ""
    _, start, _ = context.block(part.name)
    past = start is not None and start + value - 1 > LAST_ADDRESS
    return f"runs past address {LAST_ADDRESS}" if past else ""


def _echo(part: Part, value: int, context: Context, row: Function) -> str:
    expected = context.asked.get(part.path, value)
    if part.name not in row.echo or context.direction == "request" or value == expected:
        return ""
    return f"should repeat the request's {expected}"
