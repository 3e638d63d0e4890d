"""A bus and a day as one flat row: the verdict, the first diagnoses, rates, and what is in reserve.

What somebody with hundreds of taps looks at: `modlens doctor ARCHIVE --to csv` writes these rows,
and a tap publishes that of its day.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

__all__ = ["COLUMNS", "bus_day"]

_DIAGNOSES = 3

COLUMNS: Mapping[str, str] = {
    "date": "day in UTC, empty where the recording has no date",
    "bus": "name of the bus",
    "verdict": "healthy, trouble, broken, or unknown",
    "diagnosis_1": "the most harmful cause, with the unit where it is one: modlens explain CODE",
    "diagnosis_2": "the next one",
    "diagnosis_3": "the one behind it",
    "requests": "requests that tell how the line works",
    "requests_per_s": "these, from the first to the last frame",
    "failed_share": "share without a valid answer, exceptions left out",
    "damaged_share": "share with damage",
    "late_share": "share answered after the request had been given up",
    "weakest_unit": "the unit that answers the least share of its requests",
    "answered_share": "that share",
    "slowest_unit": "the unit that leaves the least of the time-out; without one, the slowest",
    "response_time_p99_us": "the time that 99 of 100 of its answers keep within",
    "timeout_us": "the master's time-out, where it was seen",
    "time_reserve": "the share of the time-out that is left behind those 99 of 100",
    "sentence": "the verdict in words",
}
"""Key -> meaning, in order; what a recording does not tell is null. Shares are from 0 to 1."""


def bus_day(day: Mapping[str, Any]) -> dict[str, Any]:
    """The row of an item of `_modlens.Days.rows`."""
    units: list[Mapping[str, Any]] = day["reserves"]
    requests, seconds = day["requests"], day["seconds"]
    weakest = _least(units, lambda unit: _share(unit["answered"], unit["requests"]))
    slowest = _least(units, _time_left)
    codes: list[str | None] = [_diagnosis(one) for one in day["diagnoses"][:_DIAGNOSES]]
    codes += [None] * (_DIAGNOSES - len(codes))
    row = {
        "date": day["date"],
        "bus": day["bus"],
        "verdict": day["verdict"],
        **{f"diagnosis_{number}": code for number, code in enumerate(codes, 1)},
        "requests": requests,
        "requests_per_s": round(requests / seconds, 3) if seconds else None,
        "failed_share": _share(day["failed"], requests),
        "damaged_share": _share(sum(unit["damaged"] for unit in units), requests),
        "late_share": _share(sum(unit["late"] for unit in units), requests),
        "weakest_unit": weakest and weakest["unit"],
        "answered_share": weakest and _share(weakest["answered"], weakest["requests"]),
        "slowest_unit": slowest and slowest["unit"],
        "response_time_p99_us": slowest and slowest["response_time_p99_us"],
        "timeout_us": slowest and slowest["timeout_us"],
        "time_reserve": slowest and _reserve(slowest),
        "sentence": day["sentence"],
    }
    return {key: row[key] for key in COLUMNS}


def _diagnosis(one: Mapping[str, Any]) -> str:
    """A cause in a word or two.

    >>> _diagnosis({"code": "no_bias", "unit": None}), _diagnosis({"code": "slow", "unit": 7})
    ('no_bias', 'slow unit 7')
    """
    return str(one["code"]) if one["unit"] is None else f"{one['code']} unit {one['unit']}"


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 5) if whole else None


def _reserve(unit: Mapping[str, Any]) -> float | None:
    """The share of the time-out that is left; below 0 where answers come later."""
    p99, timeout = unit["response_time_p99_us"], unit["timeout_us"]
    return None if p99 is None or not timeout else round(1 - p99 / timeout, 5)


def _time_left(unit: Mapping[str, Any]) -> float | None:
    """An order of units by their reserve of time; by their slowness where no time-out is known."""
    reserve, p99 = _reserve(unit), unit["response_time_p99_us"]
    return reserve if reserve is not None or p99 is None else 1e9 - p99


def _least(
    units: Iterable[Mapping[str, Any]], by: Callable[[Mapping[str, Any]], float | None]
) -> Mapping[str, Any] | None:
    """The unit with the least value, among those that have one."""
    known = [(value, unit["unit"], unit) for unit in units if (value := by(unit)) is not None]
    return min(known, key=lambda one: one[:2])[2] if known else None
