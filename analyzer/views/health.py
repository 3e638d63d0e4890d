"""Draws what the doctor says: the verdict, the causes, the margins, and what could not be judged.

The judgement is the core's (crates/modlens-diagnosis); this file only draws it.
`FileRun.doctor()` gives one JSON object, which docs/doctor.schema.json describes:

```
{"verdict": "healthy" | "trouble" | "broken" | "unknown", "sentence": text,
 "requests": int, "failed": int,              those that tell how the line works
 "diagnoses": [{"code", "title", "severity", "bus", "unit", "function", "address", "client",
                "failed", "total", "since", "until", "episodes", "certainty", "explains", "share",
                "odds", "rival", "chance", "sentence", "evidence", "advice", "proof",
                "examples": [int]}],          by harm
 "unexplained": [{"bus": text, "odd": int, "unexplained": int, "sentence": text}],
 "reserves": [{"bus": text, "unit": int, "requests": int, "answered": int, "damaged": int,
               "late": int, "line_errors": int,     frames with parity or framing errors
               "timed": int,                  answers with a usable response time
               "response_time_p99_us": float | null,
               "timeout_us": float | null,    the master's timeout, where it was seen
               "clock": "utc" | "relative" | "none"}],
 "not_judged": [{"bus": text, "what": text, "needs": text}]}
```
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from analyzer.views import cells
from analyzer.views.grid import ColumnLayout, Grid, GridColumn
from analyzer.views.screen import Part, Screen, visible

__all__ = [
    "brief",
    "level",
    "reserves",
    "show_health",
    "show_verdict",
    "unexplained",
    "verdict",
]

_VERDICTS = {"healthy": "ok", "trouble": "odd", "broken": "bad", "unknown": "note"}
_SEVERITIES = {"error": "bad", "warning": "odd", "info": "note"}
_WIDEST = 100


def verdict(doctor: Mapping[str, Any], width: int) -> Iterator[list[Part]]:
    """The lines of the verdict."""
    return _wrapped(doctor["sentence"], min(width, _WIDEST), style=_VERDICTS[doctor["verdict"]])


def brief(doctor: Mapping[str, Any], width: int) -> Iterator[list[Part]]:
    """What to check for each cause; the sentence of the first one is part of the verdict."""
    width = min(width, _WIDEST)
    for number, row in enumerate(doctor["diagnoses"], 1):
        code = (f"{number}. {row['code']} ", _SEVERITIES[row["severity"]])
        is_told = row["sentence"] in doctor["sentence"]
        said = f"Check: {row['advice']}" if is_told else f"{row['sentence']} {row['advice']}"
        first, *rest = textwrap.wrap(
            visible(said), max(width - 3, 20), initial_indent=" " * (len(code[0]) - 3)
        )
        yield [code, (first.lstrip(), "")]
        yield from ([(f"   {line}", "")] for line in rest)


def reserves(doctor: Mapping[str, Any], width: int) -> Iterator[list[Part]]:
    """The table of the units, with its head; nothing where no unit was asked."""
    if doctor["reserves"]:
        yield [("margin per unit", "head")]
        yield from _reserves(doctor["reserves"], min(width, _WIDEST))


def show_verdict(doctor: Mapping[str, Any], screen: Screen) -> None:
    """Print the verdict alone."""
    screen.lines(list(verdict(doctor, screen.width)))


def show_health(doctor: Mapping[str, Any], screen: Screen) -> None:
    """Print all that the doctor says."""
    show_verdict(doctor, screen)
    screen.lines(list(_lines(doctor, min(screen.width, _WIDEST))))


def _lines(doctor: Mapping[str, Any], width: int) -> Iterator[list[Part]]:
    buses = dict.fromkeys(row["bus"] for row in doctor["reserves"])
    for number, row in enumerate(doctor["diagnoses"], 1):
        yield []
        yield from _diagnosis(number, row, width, names_bus=len(buses) > 1)
    for text in unexplained(doctor):
        yield []
        yield from _wrapped(text, width)
    if doctor["reserves"]:
        yield []
        yield from reserves(doctor, width)
    if doctor["not_judged"]:
        yield []
        yield [("not judged", "head")]
    said: dict[tuple[str, str], list[str]] = {}
    for row in doctor["not_judged"]:
        said.setdefault((row["what"], row["needs"]), []).append(row["bus"])
    for (what, needs), on in said.items():
        where = f"{cells.labels(on)[on[0]]}: " if len(buses) > 1 and len(on) == 1 else ""
        yield from _wrapped(f"{where}{what}. This needs {needs}.", width, indent=2)


def level(row: Mapping[str, Any]) -> str:
    """Return the severity, after the certainty where that is less than a diagnosis."""
    certainty, severity = row["certainty"], row["severity"]
    return severity if certainty == "diagnosed" else f"{certainty}, {severity}"


def unexplained(doctor: Mapping[str, Any]) -> Iterator[str]:
    """What no cause explains, in words; nothing where there is no diagnosis."""
    for row in doctor["unexplained"] if doctor["diagnoses"] else ():
        if row["sentence"]:
            yield f"{row['bus']}: {row['sentence']}"


def _diagnosis(
    number: int, row: Mapping[str, Any], width: int, *, names_bus: bool
) -> Iterator[list[Part]]:
    """Its code, the sentence, where to look, what to do, and what would prove it."""
    where = f", {row['bus']}" if names_bus else ""
    yield [
        (f"{number}. ", ""),
        (row["code"], _SEVERITIES[row["severity"]]),
        (f" ({level(row)}{visible(where)})", "dim"),
    ]
    examples = ", ".join(map(str, row["examples"]))
    shown = f" See transactions {examples}." if len(row["examples"]) > 1 else ""
    if len(row["examples"]) == 1:
        shown = f" See transaction {examples}."
    yield from _wrapped(f"{row['sentence']}{shown}", width, indent=3)
    if row["evidence"]:
        yield from _wrapped(row["evidence"], width, indent=3)
    yield from _wrapped(f"Check: {row['advice']}", width, indent=3)
    yield from _wrapped(f"Proof: {row['proof']}", width, indent=3)


def _reserves(rows: Sequence[Mapping[str, Any]], width: int) -> Iterator[list[Part]]:
    """A line a unit: answers, the slowest of a hundred against the timeout, damage."""
    fields = [
        GridColumn(
            ColumnLayout("unit", 4, align_right=True), lambda row: cells.number(row["unit"])
        ),
        GridColumn(
            ColumnLayout("requests", 8, align_right=True), lambda row: f"{row['requests']:,}"
        ),
        GridColumn(ColumnLayout("answered", 8, align_right=True), _answered, _answered_style),
        GridColumn(
            ColumnLayout("p99 ms", 7, align_right=True),
            lambda row: cells.milliseconds(row["response_time_p99_us"]),
        ),
        GridColumn(
            ColumnLayout("timeout ms", 10, align_right=True, spare=1),
            lambda row: cells.milliseconds(row["timeout_us"]),
        ),
        GridColumn(
            ColumnLayout("late", 5, align_right=True, spare=3), lambda row: _some(row["late"])
        ),
        GridColumn(ColumnLayout("damaged", 7, align_right=True), lambda row: _some(row["damaged"])),
    ]
    if any(0 < row["timed"] < row["answered"] for row in rows):
        fields.insert(3, GridColumn(ColumnLayout("measured", 5, align_right=True, spare=2), _timed))
    if any(row["line_errors"] for row in rows):
        fields.append(
            GridColumn(
                ColumnLayout("line errors", 11, align_right=True, spare=4),
                lambda row: _some(row["line_errors"]),
            )
        )
    buses = tuple(dict.fromkeys(row["bus"] for row in rows))
    if len(buses) > 1:
        fields.insert(0, cells.bus_field(buses, lambda row: str(row["bus"])))
    grid = Grid(fields, rows, width)
    yield grid.head()
    for row in rows:
        yield grid.line(row)
    if "measured" in grid.titles:
        yield from _wrapped(cells.MEASURED, width, style="dim")


def _timed(row: Mapping[str, Any]) -> str:
    """Of how many answers the response times are."""
    return cells.share_of(row["timed"], row["answered"])


def _some(count: int) -> str:
    return f"{count:,}" if count else ""


def _answered(row: Mapping[str, Any]) -> str:
    if row["answered"] == row["requests"]:
        return "all"
    # Never rounded up to 100 %, which would hide the failures.
    share = min(row["answered"] / row["requests"], 0.999)
    return f"{share:.1%}"


def _answered_style(row: Mapping[str, Any]) -> str:
    return "" if row["answered"] == row["requests"] else "bad"


def _wrapped(text: str, width: int, *, indent: int = 0, style: str = "") -> Iterator[list[Part]]:
    for line in textwrap.wrap(visible(text), max(width - indent, 20)):
        yield [(f"{' ' * indent}{line}", style)]
