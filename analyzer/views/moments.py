"""When a row was.

Time of day, time since the start, time since the row before, or the place in the file.

The first rows decide which of them there is; the head of the column says which it is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from analyzer.times import clock_text, seconds, zone_text
from analyzer.views.grid import Field, Head

__all__ = ["TIMES", "Moments"]

TIMES = ("local", "utc", "elapsed", "delta")

_PLACE = re.compile(r"([@:#])(\d+)$")
_PLACES = {"@": "offset", ":": "line", "#": "packet"}


class Moments:
    """The time column of one table: `wanted` is one of `TIMES`, `digits` those of a second."""

    def __init__(self, wanted: str, rows: Sequence[Any], digits: int) -> None:
        self._digits = digits
        self._before: float | None = None
        self._day = ""
        first = rows[0]
        clock = first.time is not None
        if wanted in ("local", "utc") and clock:
            self._kind = wanted
        elif first.elapsed_us is not None:
            self._kind = "delta" if wanted == "delta" else "elapsed"
        else:
            self._kind = "place"
        self._title = self._head(first)

    def field(self) -> Field:
        """The column."""
        if self._kind in ("local", "utc"):
            least = len("00:00:00.") + self._digits
            return Field(Head(self._title, least, right=True), self._clock, lambda _: "dim")
        if self._kind == "place":
            return Field(Head(self._title, 7, right=True), _place, lambda _: "dim")
        cell = self._elapsed if self._kind == "elapsed" else self._delta
        return Field(Head(self._title, 5 + self._digits, right=True), cell, lambda _: "dim")

    def day(self, row: Any) -> str | None:
        """The date, if it is another than that of the row before."""
        if self._kind not in ("local", "utc") or row.time is None:
            return None
        day = f"{self._zoned(row.time):%Y-%m-%d}"
        if day == self._day:
            return None
        self._day = day
        return day

    def advance(self, row: Any) -> None:
        """The row has been printed: the next one counts from it."""
        self._before = row.elapsed_us

    def _head(self, first: Any) -> str:
        if self._kind in ("local", "utc"):
            return f"time {zone_text(self._zoned(first.time))}"
        if self._kind == "place":
            match = _PLACE.search(getattr(first, "source", None) or "")
            return _PLACES[match[1]] if match else "place"
        return f"{self._kind} s"

    def _zoned(self, moment: datetime) -> datetime:
        return moment.astimezone(UTC if self._kind == "utc" else None)

    def _clock(self, row: Any) -> str:
        return "" if row.time is None else clock_text(self._zoned(row.time), self._digits)

    def _elapsed(self, row: Any) -> str:
        return "" if row.elapsed_us is None else seconds(row.elapsed_us, self._digits)

    def _delta(self, row: Any) -> str:
        if row.elapsed_us is None:
            return ""
        before = row.elapsed_us if self._before is None else self._before
        return seconds(row.elapsed_us - before, self._digits)


def _place(row: Any) -> str:
    match = _PLACE.search(getattr(row, "source", None) or "")
    return match[2] if match else ""
