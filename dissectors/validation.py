"""Checks numbers in a PDU against the specification and the request.

Limits of single fields, announced lengths, the address range, and fields that a response has to
repeat.
"""

from __future__ import annotations

from dissectors.context import LAST_ADDRESS, Context
from dissectors.pdu import DecodedField
from dissectors.table import LIST_ITEM_BYTES, Function

__all__ = ["violations"]


def violations(part: DecodedField, value: int, context: Context) -> tuple[str, ...]:
    """The violations of a number in a PDU, in a few words each; empty if it is valid."""
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


def _limit(part: DecodedField, value: int, row: Function) -> str:
    low, high = row.limits.get(part.name, (value, value))
    if not low <= value <= high:
        return f"the specification permits {low} to {high}"
    allowed = row.allowed.get(part.name)
    if allowed is not None and value not in allowed:
        shown = " or ".join(f"0x{item:0{2 * part.length}X}" for item in allowed)
        return f"the specification permits {shown}"
    return ""


def _announced(part: DecodedField, value: int, context: Context) -> str:
    """A byte count compared with the bytes that follow, and with what the quantity takes."""
    follow = context.bytes_after(part) if part.field_type.startswith("len") else None
    if follow is None:
        return ""
    if value != follow:
        return "too few" if follow < value else "too many"
    lists = [
        item
        for item in context.pdu.fields
        if item.field_type == "bits" or item.field_type in LIST_ITEM_BYTES
    ]
    quantity = context.register_block(lists[0].name)[2] if len(lists) == 1 else None
    if quantity is None:
        return ""
    needed = (
        -(-quantity // 8)
        if lists[0].field_type == "bits"
        else quantity * LIST_ITEM_BYTES[lists[0].field_type]
    )
    return "" if needed == value else f"but a quantity of {quantity} takes {needed}"


def _reach(part: DecodedField, value: int, context: Context) -> str:
    if not part.name.endswith("quantity"):
        return ""
    _, start, _ = context.register_block(part.name)
    past = start is not None and start + value - 1 > LAST_ADDRESS
    return f"reaches beyond address {LAST_ADDRESS}" if past else ""


def _echo(part: DecodedField, value: int, context: Context, row: Function) -> str:
    expected = context.request_numbers.get(part.path, value)
    if part.name not in row.echo or context.direction == "request" or value == expected:
        return ""
    return f"should repeat the request's {expected}"
