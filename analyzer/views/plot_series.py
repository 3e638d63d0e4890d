"""Values over time as a plot takes them: runs without gaps, and the ticks of the axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from statistics import median
from typing import Any, Literal

__all__ = ["AXES", "Axis", "Plot", "Point", "Series", "runs", "seconds_of", "text_of", "ticks"]

Axis = Literal["utc", "seconds", "transaction"]
AXES: tuple[Axis, ...] = ("utc", "seconds", "transaction")
"""The finest first."""

Point = tuple[float, float]

_GAP = 3.0
"""After so many times the usual interval a value was not heard."""

_MOST_TICKS = 7
_DAY_S = 86400
_STEPS_S = (
    *(0.001, 0.01, 0.1, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800),
    *(3600, 7200, 10800, 21600, 43200),
    *(_DAY_S * days for days in (1, 2, 7, 14, 30, 90, 365)),
)


@dataclass(slots=True)
class Series:
    """The values of one reading with its unit of measure; `at` has their places on the axis."""

    unit: str
    values: list[float] = field(default_factory=list)
    at: list[float] = field(default_factory=list)

    @property
    def points(self) -> list[Point]:
        """Pairs of x and value."""
        return list(zip(self.at, self.values, strict=True))


Plot = dict[str, Series]
"""Name -> its values."""


def runs(series: Series, points: Sequence[Point], axis: Axis) -> list[list[Point]]:
    """The points, in runs between which nothing was heard."""
    steps = [after - before for before, after in zip(series.at, series.at[1:], strict=False)]
    most = _GAP * median(steps) if axis != "transaction" and len(steps) > 1 else 0.0
    found: list[list[Point]] = []
    for point in points:
        if not found or (most and point[0] - found[-1][-1][0] > most):
            found.append([])
        found[-1].append(point)
    return found


def seconds_of(time: Any) -> float | None:
    """A time of the tables as seconds since 1970.

    >>> seconds_of("1970-01-01T00:01:00.500000123Z"), seconds_of(None)
    (60.5, None)
    """
    return datetime.fromisoformat(time).timestamp() if isinstance(time, str) else None


def text_of(at: float, axis: Axis, *, step: float = 0.0, date: bool = True) -> str:
    """A place on the axis; times to the second, or finer where ticks are closer.

    >>> text_of(0.25, "utc", step=0.1), text_of(3600, "utc", step=60, date=False)
    ('1970-01-01 00:00:00.250', '01:00')
    """
    if axis != "utc":
        return f"{at:g}"
    moment = datetime.fromtimestamp(at, UTC).replace(tzinfo=None)
    spec = "minutes" if step >= 60 else "milliseconds" if 0 < step < 1 else "seconds"  # noqa: PLR2004
    text = moment.isoformat(" ", spec)
    return text if date else text[11:]


def ticks(left: float, right: float, axis: Axis) -> Iterator[tuple[float, str]]:
    """Places and texts of the ticks: round times of day, with the date at midnight."""
    if axis != "utc":
        yield from ((at, f"{at:g}") for at in (left, right))
        return
    steps = (one for one in _STEPS_S if (right - left) / one <= _MOST_TICKS)
    step = next(steps, right - left)
    number = -(-left // step)
    while number * step <= right:
        at = number * step
        midnight = at % _DAY_S == 0 and step >= 1
        yield at, text_of(at, axis)[:10] if midnight else text_of(at, axis, step=step, date=False)
        number += 1
