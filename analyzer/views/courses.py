"""Draws the time series of `modlens stats`: what happened over time on each bus, in a line each."""

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
    """Print load, failures and each unit's response times over time."""
    buses = [bus for bus in overview["buses"] if bus is not None]
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
    units = bus["requests"]["units"]
    for unit in units[:MOST_UNITS]:
        yield _unit(unit["unit"], unit["p95_us"], width)
    if len(units) > MOST_UNITS:
        yield [(f"and {len(units) - MOST_UNITS} more units", "dim")]


def _unit(unit: int, p95_us: Sequence[float | None], width: int) -> list[Part]:
    """The 95th percentile of a unit's response times in each bucket; empty where it was silent."""
    longest = max((one for one in p95_us if one is not None), default=None)
    told = "no response time" if longest is None else f"up to {cells.milliseconds(longest)} ms"
    return _row(f"unit {unit} p95", p95_us, width, told, "")


def _row(
    name: str, values: Sequence[float | None], width: int, told: str, style: str
) -> list[Part]:
    return [
        (f"{name:{_NAME_COLUMNS}}", ""),
        (sparkline(values, width), style),
        (f"  {told}", "dim"),
    ]
