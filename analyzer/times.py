"""Moments as integer nanoseconds since 1970 UTC: read from ISO text, written for tables.

>>> parse_ns("2023-10-11T14:00:00.000000001Z")
1697032800000000001
>>> parse_ns("2023-10-11")
1696982400000000000
>>> seconds(1_500_250.0, 6)
'1.500250'
"""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

__all__ = ["clock_text", "parse_ns", "seconds", "zone_text"]

_ISO = re.compile(
    r"(?P<date>\d{4}-\d\d-\d\d)"
    r"(?:[T ](?P<clock>\d\d:\d\d(?::\d\d)?)(?:[.,](?P<fraction>\d{1,9}))?)?"
    r"\s*(?P<zone>Z|[+-]\d\d:?\d\d)?"
)


def parse_ns(text: str) -> int | None:
    """Nanoseconds since 1970 of an ISO-8601 date, or date and time.

    Without a zone it is UTC. None if it is neither.
    """
    match = _ISO.fullmatch(text.strip())
    if not match:
        return None
    zone = match["zone"] or "Z"
    try:
        moment = datetime.fromisoformat(f"{match['date']}T{match['clock'] or '00:00'}{zone}")
    except ValueError:
        return None
    whole = (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1)
    return whole * 1_000_000_000 + int((match["fraction"] or "0").ljust(9, "0"))


def seconds(elapsed_us: float, digits: int) -> str:
    """Microseconds as seconds with a fixed number of digits."""
    return f"{elapsed_us / 1e6:.{digits}f}"


def clock_text(moment: datetime, digits: int) -> str:
    """The time of day of a moment, cut (not rounded.

    A clock does not run ahead) to 0 to 6 digits of a second.
    """
    text = f"{moment:%H:%M:%S}"
    return f"{text}.{moment.microsecond:06d}"[: len(text) + 1 + digits] if digits else text


def zone_text(moment: datetime) -> str:
    """The moment's zone as `+02:00`, `UTC` where it has no shift."""
    shift = moment.utcoffset() or timedelta(0)
    if not shift:
        return "UTC"
    minutes = shift // timedelta(minutes=1)
    sign = "-" if minutes < 0 else "+"
    return f"{sign}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"
