"""`--between T1 T2`: the part of a recording from T1 (inclusive) to T2 (exclusive).

It is a filter like `--where`, and both may be there:

>>> combine_filters("unit == 1 or unit == 2", ["2023-10-11T14:00", "2023-10-11T14:05"])
"(unit == 1 or unit == 2) and (time >= '2023-10-11T14:00' and time < '2023-10-11T14:05')"
>>> combine_filters(None, ["90", "120.5"])
'(elapsed_us >= 90000000 and elapsed_us < 120500000)'
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation

from analyzer.times import parse_ns
from dissectors.errors import UsageError

__all__ = ["combine_filters"]


def combine_filters(where: str | None, between: Sequence[str] | None) -> str | None:
    """Combine `--where` and `--between` into one filter text; None where neither is given.

    A bound is an ISO time, UTC unless it says its zone, or a number of seconds since the first byte
    of the recording. `UsageError` if one is neither, or if nothing can be between them.
    """
    if between is None:
        return where
    (key, first, low), (last_key, last, high) = (_bound(text) for text in between)
    if key != last_key:
        raise UsageError(
            f"--between {' '.join(between)}: give two times, or two numbers of"
            " seconds, not one of each"
        )
    if last <= first:
        raise UsageError(f"--between {' '.join(between)}: T2 is before T1")
    inside = f"({key} >= {low} and {key} < {high})"
    return inside if where is None else f"({where}) and {inside}"


def _bound(text: str) -> tuple[str, Decimal, str]:
    """One bound of `--between`: the column it compares, its value there, and its filter literal."""
    moment = parse_ns(text)
    if moment is not None:
        return "time", Decimal(moment), repr(text)
    try:
        number = Decimal(text) * 1_000_000
        if number.is_finite():
            return "elapsed_us", number, str(int(number))
    except InvalidOperation:
        pass
    raise UsageError(
        f"--between {text}: not a time; write 2023-10-11T14:00:00Z, or seconds since the start"
        " of the recording"
    )
