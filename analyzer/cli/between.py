"""`--between T1 T2`: the part of a recording from T1 (inclusive) to T2 (exclusive).

It is a filter like `--where`, and both may be there:

>>> combine_filters("unit == 1 or unit == 2", ["2023-10-11T14:00Z", "2023-10-11T14:05Z"])
"(unit == 1 or unit == 2) and (time >= '2023-10-11T14:00Z' and time < '2023-10-11T14:05Z')"
>>> combine_filters(None, ["90", "120.5"])
'(elapsed_us >= 90000000 and elapsed_us < 120500000)'
>>> combine_filters(None, ["23:59:58", "0:00:02"], zone="utc")
"(time >= '23:59:58 utc' or time < '0:00:02 utc')"
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from typing import Literal

from analyzer.filters import parse
from analyzer.times import parse_ns, parse_time_of_day
from dissectors.errors import UsageError

__all__ = ["combine_filters", "is_over_midnight"]

Zone = Literal["local", "utc"]

_DAYS = {"yesterday": -1, "today": 0, "tomorrow": 1}
_DATE = re.compile(r"\d{4}-\d\d-\d\d")
_SAYS_ZONE = re.compile(r".*(?:Z|utc|local|:\d\d[.,\d]*\s*[+-]\d\d:?\d\d)")


@dataclass(frozen=True, slots=True)
class _Bound:
    """One bound: what kind of time it is, its value to compare with the other, and its literal."""

    kind: str
    value: Decimal
    literal: str

    def column(self, table: str) -> str:
        if self.kind == "seconds":
            return "elapsed_us"
        return "opened" if table == "connections" else "time"


def combine_filters(
    where: str | None,
    between: Sequence[str] | None,
    *,
    zone: Zone = "local",
    table: str = "transactions",
) -> str | None:
    """Combine `--where` and `--between` into one filter text; None where neither is given.

    A bound is an ISO time, `yesterday`, `today` or `tomorrow` (the beginning of that day), a time
    of day as the table shows it (which means every day of the recording), or a number of seconds
    since the first byte of the recording. Times that do not say their zone are in `zone`. A time of
    day after a bound with a date is on that date. `UsageError` if a bound is none of these, or if
    nothing can be between them. Of the `table` of connections, those are meant that were opened in
    between.
    """
    if between is None:
        return where
    if where is not None:
        parse(where, table)  # A mistake in it is shown in its own text.
    first_text, last_text = (_day(text, zone) for text in between)
    date = _DATE.match(first_text.strip())
    if date and parse_time_of_day(last_text):
        hours, colon, rest = last_text.strip().partition(":")
        last_text = f"{date[0]}T{hours.zfill(2)}{colon}{rest}"
    first, last = _bound(first_text, zone), _bound(last_text, zone)
    if first.kind != last.kind:
        raise UsageError(
            f"--between {' '.join(between)}: give two times, two times of day, or two numbers of"
            " seconds, not one of each"
        )
    if table == "connections" and first.kind == "seconds":
        raise UsageError(
            f"--between {' '.join(between)}: connections have times, not seconds since the start;"
            " give two times"
        )
    over_midnight = first.kind == "time of day" and last.value < first.value
    if last.value <= first.value and not over_midnight:
        raise UsageError(f"--between {' '.join(between)}: T2 is before T1, or equal")
    word = "or" if over_midnight else "and"
    column = first.column(table)
    low, high = f"{column} >= {first.literal}", f"{column} < {last.literal}"
    inside = f"({low} {word} {high})"
    return inside if where is None else f"({where}) and {inside}"


def is_over_midnight(between: Sequence[str]) -> bool:
    """Whether two times of day stand for the hours from the evening to the morning."""
    first, last = map(parse_time_of_day, between)
    return first is not None and last is not None and last[0] < first[0]


def _day(text: str, zone: Zone) -> str:
    """The date that a word such as `yesterday` means; any other text as it is."""
    days = _DAYS.get(text.strip().lower())
    if days is None:
        return text
    now = datetime.now(UTC) if zone == "utc" else datetime.now().astimezone()
    return (now + timedelta(days)).date().isoformat()


def _bound(text: str, zone: Zone) -> _Bound:
    text = text.strip()
    moment = parse_ns(text, local=zone == "local")
    if moment is not None:
        says_zone = _SAYS_ZONE.fullmatch(text) is not None
        return _Bound("time", Decimal(moment), repr(text if says_zone else _utc_text(moment)))
    clock = parse_time_of_day(text)
    if clock is not None:
        literal = text if _SAYS_ZONE.fullmatch(text) else f"{text} {zone}"
        return _Bound("time of day", Decimal(clock[0]), repr(literal))
    try:
        number = Decimal(text) * 1_000_000
        if number.is_finite():
            return _Bound("seconds", number, str(int(number)))
    except InvalidOperation:
        pass
    raise UsageError(
        f"--between {text}: not a time; write 2023-10-11T14:00:00Z, 14:00:00, yesterday, or seconds"
        " since the start of the recording"
    )


def _utc_text(moment_ns: int) -> str:
    """A moment as an ISO text in UTC, to the nanosecond."""
    seconds, fraction = divmod(moment_ns, 1_000_000_000)
    whole = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{fraction:09d}Z"
