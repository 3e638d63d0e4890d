"""Times as they are given to `modlens find`: with a date, without one, since the start, a mark."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation

from analyzer.times import DAY_NS, parse_ns, parse_time_of_day
from dissectors.errors import UsageError

__all__ = ["RecordedTimes", "parsed_time"]

_CAPTURED_NS = 86_400_000_000_000 * 365
"""A recording whose first time is earlier has only times since its start."""

_STATES_ZONE = re.compile(r".*(?:Z|utc|local|[+-]\d\d:?\d\d)$")


_MARK = re.compile(r"k(\d+)")


def parsed_time(text: str, marks: Mapping[int, int], *, local: bool) -> int | None:
    """A mark, or a time with a date, in nanoseconds since 1970; None for any other."""
    mark = _MARK.fullmatch(text.strip())
    return parse_ns(text, local=local) if mark is None else marks.get(int(mark[1]))


class RecordedTimes:
    """The times of a recording, from its first to its last, in nanoseconds since 1970."""

    def __init__(self, first: int, last: int, marks: Mapping[int, int], *, local: bool) -> None:
        self._first, self._last, self._marks, self._local = first, last, marks, local

    def moment(self, text: str, option: str) -> int:
        """The moment that a text means; `UsageError` where it means none, or several."""
        text = text.strip()
        moment = parsed_time(text, self._marks, local=self._local)
        if moment is not None:
            return self._inside(moment, text, option)
        if _MARK.fullmatch(text):
            known = ", ".join(f"k{number}" for number in sorted(self._marks)) or "none"
            raise UsageError(f"{option} {text}: no such mark beside the recording (there: {known})")
        clock = parse_time_of_day(text)
        if clock is not None:
            return self._on_a_day(clock, text, option)
        try:
            seconds = Decimal(text)
        except InvalidOperation:
            seconds = Decimal("NaN")
        if not seconds.is_finite():
            raise UsageError(
                f"{option} {text}: not a time; write 12:03:10, 2026-11-21T12:03:10Z, or seconds"
                " since the start of the recording"
            )
        return self._inside(self._first + int(seconds * 1_000_000_000), text, option)

    def _inside(self, moment: int, text: str, option: str) -> int:
        slack = 600_000_000_000
        if self._first - slack <= moment <= self._last + slack:
            return moment
        raise UsageError(
            f"{option} {text}: the recording is from {self.text(self._first)} to"
            f" {self.text(self._last)}"
        )

    def _on_a_day(self, clock: tuple[int, str], text: str, option: str) -> int:
        """The moment of a time of day on the one day of the recording that has it."""
        since_midnight, zone = clock
        local = self._local and not _STATES_ZONE.fullmatch(text)
        moments = []
        day = _day(self._first, local=local) - timedelta(days=1)
        while (start := _midnight(day, zone, local=local)) <= self._last:
            moments.append(start + since_midnight)
            day += timedelta(days=1)
        inside = [one for one in moments if self._first <= one <= self._last]
        if len(inside) == 1:
            return inside[0]
        if inside:
            raise UsageError(f"{option} {text}: the recording has several such days; give the date")
        middle = (self._first + self._last) // 2
        return self._inside(min(moments, key=lambda one: abs(one - middle)), text, option)

    def text(self, moment: int) -> str:
        """A moment as text: the time of day, with the date where the recording has several days."""
        if self._first < _CAPTURED_NS:
            return f"{moment / 1e9:.1f} s"
        shown = datetime.fromtimestamp(moment / 1e9, UTC)
        if self._local:
            shown = shown.astimezone()
        form = "%H:%M:%S" if self._last - self._first < DAY_NS / 2 else "%Y-%m-%d %H:%M:%S"
        return shown.strftime(form)


def _day(moment: int, *, local: bool) -> datetime:
    shown = datetime.fromtimestamp(moment / 1e9, UTC)
    return shown.astimezone() if local else shown


def _midnight(day: datetime, zone: str, *, local: bool) -> int:
    suffix = "" if local or zone in ("utc", "local", "Z") else zone
    start = parse_ns(f"{day:%Y-%m-%d}T00:00{suffix}", local=local or zone == "local")
    return start if start is not None else 0
