"""Draws the statistics of `modlens stats`.

The counters are the core's; this file only draws them. `_modlens.Session.stats()` gives one JSON
object:

```
{"transactions": {status: int}, "findings": {code: int},     all buses; those that occurred
 "buses": [{"bus": text, "mode": "rtu" | "ascii" | "tcp" | null,
            "frames": {verdict: int}, "bytes": {verdict: int},
            "cut": int,                    of the incomplete: cut by the recording's ends
            "duration_us": float | null,   first to last byte; null without a clock
            "busy_us": float | null,       bytes times the character time; null without settings
            "utilization": float | null,   busy share of the duration, 0 to 1
            "silence": {"t35_us": float, "frames": int,
                        "delimited_differently": int} | null,
                                           frames that silences of t3.5 alone would
                                           delimit differently; null without RTU, clock
                                           or line settings
            "units": [{"unit": int, "function": int,
                       "transactions": int, "statuses": {status: int},
                       "exceptions": {"2": int}, "retries": int,
                       "response_time": {"count": int, "min_us": float, "mean_us": float,
                                         "p50_us": float, "p95_us": float, "max_us": float}
                                        | null}],
            "cycle": as response_time, "requests": int | null,   how often requests come again
            "timeouts": {"waited": as response_time,             null where all were answered
                         "requests": [{"unit": int, "function": int, "address": int | null,
                                       "quantity": int | null, "register_type": text | null,
                                       "count": int, "asked": int, "late": int,
                                       "late_by": as response_time, "damaged": int,
                                       "before": [{"unit": int, "status": text, "count": int}]}]}
                        | null,
            "driver": {counter: int}}]}      of a tap only, where the driver counts damage
```

Maps are sorted by key, so that the same recording prints the same lines everywhere.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from analyzer.counts import count_of
from analyzer.views import cells
from analyzer.views.diagnostics import describe_driver_errors, explain_timeouts, rank_findings
from analyzer.views.grid import WIDE_COLUMNS, ColumnLayout, Grid, GridColumn
from analyzer.views.polls import polls
from analyzer.views.screen import Part, Screen, visible
from dissectors.vocabulary import exception_name

__all__ = ["show_stats"]

_SEVERITIES = {"error": "bad", "warning": "odd", "info": "note"}
_INDENT = "           "

_FAILED = ("no_response", "bad_request", "bad_response")


def show_stats(
    stats: Mapping[str, Any], screen: Screen, doctor: Mapping[str, Any] | None = None
) -> None:
    """Print the buses, a line for each unit and function, then the findings, most urgent first.

    What the doctor says, if it was asked, takes the place of the findings' advice.
    """
    lines = list(_lines(stats, screen.width, doctor))
    screen.lines(lines)


def _lines(
    stats: Mapping[str, Any], width: int, doctor: Mapping[str, Any] | None
) -> Iterator[list[Part]]:
    """All lines of the statistics: buses, units and functions, timeouts, findings."""
    buses = stats["buses"]
    short = cells.labels([bus["bus"] for bus in buses])
    yield from _grid(_bus_fields(short if len(short) > 1 else {}), buses, width)
    for bus in buses:
        yield from _silence(bus, width)
        driver = describe_driver_errors(bus)
        if driver:
            yield []
            name = f"{short[bus['bus']]}: " if len(short) > 1 else ""
            yield from _wrapped(f"{name}{driver}", width)
    rows = [{**row, "bus": bus["bus"]} for bus in buses for row in bus["units"]]
    if rows:
        yield []
        fields = _row_fields(rows, is_wide=width >= WIDE_COLUMNS)
        if len(short) > 1:
            fields.insert(0, cells.bus_field(tuple(short), lambda row: str(row["bus"])))
        yield from _grid(fields, rows, width)
        if any(map(_other, rows)):
            title = "other" if width >= WIDE_COLUMNS else "count counts as well"
            yield from _notes(f"{title}: {cells.OTHER}", width)
        if any(field.head.title == "measured" for field in fields):
            yield from _notes(cells.MEASURED, width)
    yield from _exception_codes(rows, width, short if len(short) > 1 else {})
    for bus in buses:
        of_bus = {
            row["code"] for row in (doctor or {}).get("diagnoses", []) if row["bus"] == bus["bus"]
        }
        yield from _timeouts(bus, width, has_two_masters="two_masters" in of_bus)
    if stats["findings"]:
        yield []
        yield [("findings, most urgent first (modlens explain NAME)", "head")]
        for code, count, severity, advice in rank_findings(stats, doctor):
            yield [(f"{count:9,}  ", ""), (f"{code:22}", _SEVERITIES[severity])]
            yield from _wrapped(advice, width)


def _exception_codes(
    rows: Sequence[Mapping[str, Any]], width: int, short: Mapping[str, str]
) -> Iterator[list[Part]]:
    """How often each exception code came, the most frequent first, and from which functions."""
    counts: dict[int, int] = {}
    senders: dict[int, dict[str, list[str]]] = {}
    for row in rows:
        for text, count in row["exceptions"].items():
            code = int(text)
            counts[code] = counts.get(code, 0) + count
            bus = f"{short[row['bus']]}, " if short else ""
            functions = senders.setdefault(code, {}).setdefault(f"{bus}unit {row['unit']}", [])
            functions.append(f"{row['function']} ({count:,})")
    if counts:
        yield []
        yield [("exceptions by code (modlens explain exception CODE)", "head")]
    for code, count in sorted(counts.items(), key=lambda pair: (-pair[1], pair[0])):
        yield [(f"{count:9,}  ", ""), (f"{code:2d} {exception_name(code)}", "odd")]
        of_units = [f"{unit}: function {', '.join(of)}" for unit, of in senders[code].items()]
        yield from _wrapped("; ".join(of_units), width)


def _timeouts(bus: Mapping[str, Any], width: int, *, has_two_masters: bool) -> Iterator[list[Part]]:
    """The lines about the poll cycle and the timeouts of a bus."""
    cycle = bus.get("cycle")
    if cycle:
        yield []
        times = [cells.milliseconds(cycle[name]) for name in ("p50_us", "max_us")]
        text = (
            f"poll cycle: median {times[0]} ms, longest {times[1]} ms;"
            f" {count_of(cycle['requests'], 'periodic request')}"
        )
        yield from ([(line, "")] for line in textwrap.wrap(text, width))
        yield from polls(bus, width)
    lines = list(explain_timeouts(bus, has_two_masters=has_two_masters))
    if lines:
        yield []
        yield [("response timeouts", "head")]
    for line in lines:
        yield from _wrapped(line, width)


def _wrapped(text: str, width: int) -> Iterator[list[Part]]:
    for line in textwrap.wrap(visible(text), max(width - len(_INDENT), 20)):
        yield [(f"{_INDENT}{line}", "")]


def _silence(bus: Mapping[str, Any], width: int) -> Iterator[list[Part]]:
    """How many frames would have been cut otherwise by silences of t3.5 alone."""
    counts = bus["silence"]
    if counts and counts["frames"]:
        changed = counts["delimited_differently"]
        share = changed / counts["frames"]
        yield []
        text = (
            f"a receiver using t3.5 ({counts['t35_us']:,.0f} us) alone would split"
            f" {changed:,} of {count_of(counts['frames'], 'frame')} ({share:.1%}) differently"
        )
        yield from ([(line, "dim")] for line in textwrap.wrap(text, width))


def _grid(fields: Sequence[GridColumn], rows: Sequence[Any], width: int) -> Iterator[list[Part]]:
    grid = Grid(fields, rows, width)
    yield grid.head()
    for row in rows:
        yield grid.line(row)


def _bus_fields(short: Mapping[str, str]) -> list[GridColumn]:
    """The columns of the table of buses; `short` are their short names."""

    def name(bus: Mapping[str, Any]) -> str:
        return short.get(bus["bus"]) or visible(bus["bus"])

    return [
        GridColumn(ColumnLayout("bus", 8, free_share=1), name),
        GridColumn(ColumnLayout("mode", 5, spare=3), lambda bus: bus["mode"] or ""),
        GridColumn(ColumnLayout("seconds", 8, align_right=True), _duration),
        GridColumn(
            ColumnLayout("bytes", 8, align_right=True, spare=2),
            lambda bus: f"{sum(bus['bytes'].values()):,}",
        ),
        GridColumn(
            ColumnLayout("frames", 7, align_right=True),
            lambda bus: f"{sum(bus['frames'].values()):,}",
        ),
        GridColumn(
            ColumnLayout("damaged", 7, align_right=True),
            lambda bus: _some(_damaged(bus)),
            _damaged_style,
        ),
        GridColumn(
            ColumnLayout("noise", 6, align_right=True, spare=1),
            lambda bus: _some(bus["frames"].get("noise", 0)),
        ),
        GridColumn(ColumnLayout("utilization", 6, align_right=True), _utilization),
    ]


def _row_fields(rows: Sequence[Mapping[str, Any]], *, is_wide: bool) -> list[GridColumn]:
    """The columns of the table of units and functions; more times where there is room."""
    chosen = [
        GridColumn(
            ColumnLayout("unit", 4, align_right=True), lambda row: cells.number(row["unit"])
        ),
        GridColumn(ColumnLayout("function", 12, free_share=1), cells.function_name),
        GridColumn(
            ColumnLayout("transactions" if is_wide else "count", 5, align_right=True),
            lambda row: f"{row['transactions']:,}",
        ),
        GridColumn(
            ColumnLayout("ok", 4, align_right=True, spare=1),
            lambda row: _some(_with_status(row, "ok")),
        ),
        GridColumn(ColumnLayout("exceptions", 4, align_right=True), _exceptions, lambda _: "odd"),
        GridColumn(ColumnLayout("failed", 6, align_right=True), _failed, lambda _: "bad"),
        *(
            [GridColumn(ColumnLayout("other", 5, align_right=True), _other)]
            if is_wide and any(map(_other, rows))
            else []
        ),
        GridColumn(
            ColumnLayout("retry", 5, align_right=True, spare=3), lambda row: _some(row["retries"])
        ),
    ]
    if is_wide and any(0 < _timed(row) < _answered(row) for row in rows):
        chosen.append(
            GridColumn(
                ColumnLayout("measured", 5, align_right=True),
                lambda row: cells.share_of(_timed(row), _answered(row)),
            )
        )
    chosen += [
        GridColumn(
            ColumnLayout(f"{name} ms", 6, align_right=True, spare=0 if name == "p50" else 2),
            _response(f"{name}_us"),
        )
        for name in ("min", "p50", "p95", "max")
        if is_wide or name in ("p50", "max")
    ]
    return chosen


def _timed(row: Mapping[str, Any]) -> int:
    """Answers whose response times the recording reports."""
    return int((row["response_time"] or {}).get("count", 0))


def _answered(row: Mapping[str, Any]) -> int:
    """Good answers and refusals."""
    return sum(row["statuses"].get(status, 0) for status in ("ok", "exception"))


def _some(count: int) -> str:
    """A count as text; empty for 0, so that errors stand out."""
    return f"{count:,}" if count else ""


def _duration(bus: Mapping[str, Any]) -> str:
    return "" if bus["duration_us"] is None else f"{bus['duration_us'] / 1e6:,.1f}"


def _damaged(bus: Mapping[str, Any]) -> int:
    bad: int = sum(bus["frames"].get(verdict, 0) for verdict in ("bad_checksum", "incomplete"))
    cut: int = bus.get("cut", 0)
    return bad - cut


def _damaged_style(bus: Mapping[str, Any]) -> str:
    return "bad" if _damaged(bus) else ""


def _utilization(bus: Mapping[str, Any]) -> str:
    return "" if bus["utilization"] is None else f"{bus['utilization']:.1%}"


def _with_status(row: Mapping[str, Any], *statuses: str) -> int:
    return sum(row["statuses"].get(status, 0) for status in statuses)


def _exceptions(row: Mapping[str, Any]) -> str:
    return _some(_with_status(row, "exception"))


def _failed(row: Mapping[str, Any]) -> str:
    return _some(_with_status(row, *_FAILED))


def _other(row: Mapping[str, Any]) -> str:
    """Rows that are no requests, or whose outcome is not known."""
    return _some(row["transactions"] - _with_status(row, "ok", "exception", *_FAILED))


def _notes(text: str, width: int) -> Iterator[list[Part]]:
    yield from ([(line, "dim")] for line in textwrap.wrap(text, width))


def _response(name: str) -> Callable[[Mapping[str, Any]], str]:
    return lambda row: cells.milliseconds((row["response_time"] or {}).get(name))
