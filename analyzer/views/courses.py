"""Draws the courses of `modlens stats`: what happened over time on each bus, in a line each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from analyzer.views import cells
from analyzer.views.screen import Part, Screen
from analyzer.views.sparkline import sparkline

__all__ = ["show_courses"]

MOST_UNITS = 32
MOST_COLUMNS = 60

_NAME_COLUMNS = 16
_VALUE_COLUMNS = 18


def show_courses(overview: Mapping[str, Any], screen: Screen) -> None:
    """Print load, failures and the answered share of each unit over time."""
    buses = overview["buses"]
    short = cells.labels([bus["bus"] for bus in buses])
    width = max(min(screen.width - _NAME_COLUMNS - _VALUE_COLUMNS, MOST_COLUMNS), 10)
    for bus in buses:
        name = f", {short[bus['bus']]}" if len(buses) > 1 else ""
        screen.lines([[], [(f"over {_span(bus)}{name}", "head")]])
        screen.lines(list(_lines(bus, width)))


def _span(bus: Mapping[str, Any]) -> str:
    steps = bus["line"]
    if bus["axis"] == "transactions":
        return "transactions"
    return f"time ({steps['step'] * steps['count'] / 1e6:,.1f} s)"


def _lines(bus: Mapping[str, Any], width: int) -> Iterator[list[Part]]:
    line = bus["line"]
    if line["busy_us"]:
        load = [100 * busy / line["step"] for busy in line["busy_us"]]
        yield _row("load", load, width, f"up to {max(load):.0f} %", "")
    else:
        yield _row("frames", line["frames"], width, f"{sum(line['frames']):,}", "")
    for name, style in (("failed", "bad"), ("exceptions", "odd"), ("damaged", "bad")):
        if any(line[name]):
            yield _row(name, line[name], width, f"{sum(line[name]):,}", style)
    units = dict.fromkeys(row["unit"] for row in bus["requests"]["rows"])
    for unit in list(units)[:MOST_UNITS]:
        yield _unit(unit, [row for row in bus["requests"]["rows"] if row["unit"] == unit], width)
    if len(units) > MOST_UNITS:
        yield [(f"and {len(units) - MOST_UNITS} more units", "dim")]


def _unit(unit: int, rows: Sequence[Mapping[str, Any]], width: int) -> list[Part]:
    """The mean response time of a unit in each bucket; empty where it did not answer."""
    means: list[float | None] = []
    for at in range(len(rows[0]["transactions"])):
        known = [row["response_time"] for row in rows if row["response_time"]]
        timed = [(one["count"][at], one["mean_us"][at]) for one in known if one["count"][at]]
        count = sum(number for number, _ in timed)
        means.append(sum(number * mean for number, mean in timed) / count if count else None)
    longest = max((mean for mean in means if mean is not None), default=None)
    told = "no response time" if longest is None else f"up to {cells.milliseconds(longest)} ms"
    return _row(f"unit {unit} answers", means, width, told, "")


def _row(
    name: str, values: Sequence[float | None], width: int, told: str, style: str
) -> list[Part]:
    return [
        (f"{name:{_NAME_COLUMNS}}", ""),
        (sparkline(values, width), style),
        (f"  {told}", "dim"),
    ]
