"""The table view: for each unit and function counts, errors, times and the last values."""

from __future__ import annotations

from typing import Any

from analyzer.views import cells
from analyzer.views.grid import (
    WIDE_COLUMNS,
    Cell,
    ColumnLayout,
    Grid,
    GridColumn,
    NamedValues,
    RegisterValues,
)
from analyzer.views.live.activity import FAILED, LATELY_S
from analyzer.views.live.state import LiveState, UnitAge
from analyzer.views.live.status import age
from analyzer.views.screen import Part, visible

__all__ = ["lines"]

_LATELY = f"{LATELY_S / 60:.0f} min"
"""Title of the column with the errors of the last minutes."""

_SPARE = {"last value": 4, "max ms": 3, "p50 ms": 2, "per s": 1}
"""Columns that a narrow terminal does without, so that errors and age stay; the highest first."""

_TROUBLE = ("no_response", "bad_request", "bad_response")


def lines(state: LiveState, width: int, height: int) -> list[list[Part]]:
    """The column titles and a line for each unit and function."""
    stats = state.statistics
    rows = [
        {
            **row,
            "bus": bus["bus"],
            "last": state.last(bus["bus"], row["unit"], row["function"]),
            "age": state.age(bus["bus"], row["unit"]),
            "lately": state.activity.errors(bus["bus"], row["unit"], row["function"]),
        }
        for bus in stats.get("buses", ())
        for row in bus["units"]
    ]
    if not rows:
        return [[("no traffic yet", "dim")]]
    chosen = _fields(state, is_wide=width >= WIDE_COLUMNS)
    if len(state.table_options.buses) > 1:
        chosen.insert(0, cells.bus_field(state.table_options.buses, lambda row: str(row["bus"])))
    grid = Grid(chosen, rows, width)
    return [grid.head(), *(grid.line(row) for row in rows)]


def _fields(state: LiveState, *, is_wide: bool) -> list[GridColumn]:
    """The columns of the table; on a wide terminal function names are longer."""

    def rate(row: Any) -> str:
        return f"{row['transactions'] / max(state.elapsed, 1):.1f}"

    chosen = [
        GridColumn(
            ColumnLayout("unit", 4, align_right=True), lambda row: cells.number(row["unit"])
        ),
        GridColumn(
            ColumnLayout("function", 12, max_width=28 if is_wide else 18), cells.function_name
        ),
        GridColumn(
            ColumnLayout("transactions" if is_wide else "count", 6, align_right=True),
            lambda row: f"{row['transactions']:,}",
        ),
        GridColumn(ColumnLayout("per s", 5, align_right=True, spare=_SPARE["per s"]), rate),
        GridColumn(ColumnLayout("errors", 6, align_right=True), _wrong, _wrong_style),
        GridColumn(ColumnLayout(_LATELY, 5, align_right=True), _wrong_lately, _lately_style),
    ]
    chosen += [
        GridColumn(
            ColumnLayout(title, 6, align_right=True, spare=_SPARE.get(title, 0)),
            _time(f"{title.removesuffix(' ms')}_us"),
        )
        for title in (("p50 ms", "p95 ms", "max ms") if is_wide else ("p50 ms", "max ms"))
    ]
    chosen.append(
        GridColumn(
            ColumnLayout("age", 5, align_right=True),
            lambda row: _age(row["age"], state.clock()),
            lambda row: "bad" if row["age"].is_dead else "",
        )
    )
    chosen.append(
        GridColumn(
            ColumnLayout("last value", 10, free_share=1, spare=_SPARE["last value"]),
            lambda row: _last(row, state),
        )
    )
    return chosen


def _bad(row: Any) -> int:
    return sum(row["statuses"].get(status, 0) for status in FAILED)


def _wrong(row: Any) -> str:
    return f"{_bad(row) / row['transactions']:.1%}" if _bad(row) else ""


def _wrong_lately(row: Any) -> str:
    lately = row["lately"]
    return f"{lately.failed / lately.transactions:.0%}" if lately.failed else ""


def _lately_style(row: Any) -> str:
    return _wrong_style(row) if row["lately"].failed else ""


def _wrong_style(row: Any) -> str:
    return "bad" if any(status in row["statuses"] for status in _TROUBLE) else "odd"


def _time(name: str) -> Any:
    return lambda row: cells.milliseconds((row["response_time"] or {}).get(name))


def _age(found: UnitAge, now: float) -> str:
    """How long ago the unit answered; `dead` where it never did and was asked again and again."""
    if found.answered is None:
        return "dead" if found.is_dead else ""
    return age(now - found.answered)


def _last(row: Any, state: LiveState) -> Cell:
    last = row["last"]
    if last is None:
        return ""
    if last.readings:
        return NamedValues(
            [(visible(name), visible(str(value))) for name, value in last.readings.items()]
        )
    return RegisterValues(last, state.table_options.address)
