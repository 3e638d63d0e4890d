"""Moments as integer nanoseconds since 1970 UTC, and the UTC offsets of time zones.

>>> parse_ns("2023-10-11T14:00:00.000000001Z")
1697032800000000001
>>> parse_ns("2023-10-11")
1696982400000000000
>>> format_seconds(1_500_250.0, 6)
'1.500250'
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, date, datetime, time, timedelta

from dissectors.errors import UsageError

__all__ = [
    "DAY_NS",
    "check_date",
    "format_seconds",
    "parse_ns",
    "parse_time_of_day",
    "utc_offset_changes",
]

DAY_NS = 86_400_000_000_000

_NS_PER_S = 1_000_000_000
# Compiled where they are first asked for (`re` keeps them), since that takes a millisecond.
_FIXED_OFFSET = r"([+-])(\d\d):?(\d\d)"
_FIRST_YEAR, _LAST_YEAR, _STEP_S = 1990, 2060, 7 * 86_400

_ISO = (
    r"(?P<date>\d{4}-\d\d-\d\d)"
    r"(?:[T ](?P<clock>\d\d:\d\d(?::\d\d)?)(?:[.,](?P<fraction>\d{1,9}))?)?"
    r"\s*(?P<zone>Z|[+-]\d\d:?\d\d)?"
)
_TIME_OF_DAY = (
    r"(?P<h>\d{1,2}):(?P<m>\d\d)(?::(?P<s>\d\d)(?:[.,](?P<fraction>\d{1,9}))?)?"
    r"\s*(?P<zone>Z|utc|local|[+-]\d\d:?\d\d)?"
)


def parse_ns(text: str, *, local: bool = False) -> int | None:
    """Parse an ISO-8601 date, or date and time; gives nanoseconds since 1970 UTC.

    Without a zone the text is taken for UTC, or with `local` for the time of this computer. None if
    it is neither a date nor a time.
    """
    match = re.fullmatch(_ISO, text.strip())
    if not match:
        return None
    zone = match["zone"] or ("" if local else "Z")
    try:
        moment = datetime.fromisoformat(f"{match['date']}T{match['clock'] or '00:00'}{zone}")
        moment = moment.astimezone(UTC)
    except (ValueError, OverflowError):
        return None
    whole = (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1)
    return whole * 1_000_000_000 + int((match["fraction"] or "0").ljust(9, "0"))


def parse_time_of_day(text: str) -> tuple[int, str] | None:
    """Parse a time without a date; gives nanoseconds since midnight, and its zone (utc if none).

    >>> parse_time_of_day("12:00:05.25"), parse_time_of_day("7:30 +02:00")
    ((43205250000000, 'utc'), (27000000000000, '+02:00'))
    >>> parse_time_of_day("24:00"), parse_time_of_day("noon")
    (None, None)
    """
    match = re.fullmatch(_TIME_OF_DAY, text.strip())
    if not match:
        return None
    hours, minutes, seconds = (int(match[part] or 0) for part in ("h", "m", "s"))
    try:
        time(hours, minutes, seconds)
    except ValueError:
        return None
    fraction = int((match["fraction"] or "0").ljust(9, "0"))
    whole = (hours * 60 + minutes) * 60 + seconds
    return whole * _NS_PER_S + fraction, match["zone"] or "utc"


def format_seconds(elapsed_us: float, digits: int) -> str:
    """Write microseconds as seconds with a fixed number of decimal digits."""
    return f"{elapsed_us / 1e6:.{digits}f}"


def check_date(text: str | None) -> str | None:
    """The date of `--date`, checked; `UsageError` shows the accepted form."""
    if text is None:
        return None
    try:
        known = date.fromisoformat(text).isoformat() == text
    except ValueError:
        known = False
    if not known:
        raise UsageError(f"--date {text}: write the date as 2026-11-21")
    return text


def utc_offset_changes(zone: str | None) -> list[tuple[int, int]]:
    """The UTC offsets of a zone as pairs: the moment from which one holds, and the offset.

    Both are nanoseconds, moments since 1970 UTC. `zone` is `utc`, `local`, a name such as
    `Europe/Berlin`, or an offset such as `+01:00`; None gives an empty list. `UsageError` if it is
    none of these. Changes are searched for in steps of a week, then by bisection, since neither
    `zoneinfo` nor `datetime` lists them.

    >>> utc_offset_changes("+01:00")
    [(-4611686018427387904, 3600000000000)]
    >>> [offset // 3600 // 10**9 for _, offset in utc_offset_changes("Europe/Berlin")[:3]]
    [1, 2, 1]
    """
    if zone is None:
        return []
    if fixed := re.fullmatch(_FIXED_OFFSET, zone):
        offset = (int(fixed[2]) * 60 + int(fixed[3])) * 60 * _NS_PER_S
        return [(-(1 << 62), offset if fixed[1] == "+" else -offset)]
    offset_at = _utc_offset_function(zone)
    moment = int(datetime(_FIRST_YEAR, 1, 1, tzinfo=UTC).timestamp())
    end = int(datetime(_LAST_YEAR, 1, 1, tzinfo=UTC).timestamp())
    found = [(-(1 << 62), offset_at(moment) * _NS_PER_S)]
    while moment < end:
        if offset_at(moment) != offset_at(moment + _STEP_S):
            change = _find_change(offset_at, moment, moment + _STEP_S)
            found.append((change * _NS_PER_S, offset_at(change) * _NS_PER_S))
        moment += _STEP_S
    return found


def _utc_offset_function(zone: str) -> Callable[[int], int]:
    """A function from seconds since 1970 to the zone's offset from UTC in seconds."""
    if zone.lower() in ("utc", "z"):
        return lambda moment: 0
    if zone == "local":
        return lambda moment: _offset_seconds(datetime.fromtimestamp(moment).astimezone())
    import zoneinfo  # noqa: PLC0415 - hardly ever asked for

    try:
        there = zoneinfo.ZoneInfo(zone)
    except (OSError, ValueError, zoneinfo.ZoneInfoNotFoundError) as error:
        raise UsageError(
            f"--timezone {zone}: no such zone; write utc, local, Europe/Berlin or +01:00"
        ) from error
    return lambda moment: _offset_seconds(datetime.fromtimestamp(moment, there))


def _offset_seconds(moment: datetime) -> int:
    return (moment.utcoffset() or timedelta()) // timedelta(seconds=1)


def _find_change(offset_at: Callable[[int], int], low: int, high: int) -> int:
    """The first second between `low` and `high` at which the offset differs from that at `low`."""
    before = offset_at(low)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if offset_at(middle) == before else (low, middle)
    return high
