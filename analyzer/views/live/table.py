"""Units and functions: how many, how fast, how well, and the last value."""

from __future__ import annotations

from typing import Any

from analyzer.views import cells
from analyzer.views.grid import ROOMY, Carried, Field, Grid, Head
from analyzer.views.live.state import Board
from analyzer.views.screen import Part

__all__ = ["lines"]

_TROUBLE = ("no_response", "bad_request", "bad_response")


def lines(board: Board, width: int, height: int) -> list[list[Part]]:
    """The head and a line for each unit and function."""
    stats = board.statistics
    rows = [
        {**row, "bus": bus["bus"], "last": board.last(bus["bus"], row["unit"], row["function"])}
        for bus in stats.get("buses", ())
        for row in bus["units"]
    ]
    if not rows:
        return [[("nothing heard yet", "dim")]]
    chosen = _fields(board, roomy=width >= ROOMY)
    if len(board.look.buses) > 1:
        chosen.insert(0, cells.bus_field(board.look.buses, lambda row: str(row["bus"])))
    grid = Grid(chosen, rows, width)
    return [grid.head(), *(grid.line(row) for row in rows)]


def _fields(board: Board, *, roomy: bool) -> list[Field]:
    def rate(row: Any) -> str:
        return f"{row['transactions'] / max(board.elapsed, 1):.1f}"

    chosen = [
        Field(Head("unit", 4, right=True), lambda row: cells.number(row["unit"])),
        Field(Head("function", 12, most=28 if roomy else 18), cells.function_name),
        Field(Head("txns", 6, right=True), lambda row: f"{row['transactions']:,}"),
        Field(Head("per s", 5, right=True), rate),
        Field(Head("wrong", 6, right=True), _wrong, _wrong_style),
    ]
    chosen += [
        Field(Head(f"{name} ms", 6, right=True), _time(f"{name}_us"))
        for name in ("p50", "p95", "max")
    ]
    chosen.append(Field(Head("last value", 10, share=1), lambda row: _last(row, board)))
    return chosen


def _bad(row: Any) -> int:
    return sum(row["statuses"].get(status, 0) for status in (*_TROUBLE, "exception"))


def _wrong(row: Any) -> str:
    return f"{_bad(row) / row['transactions']:.1%}" if _bad(row) else ""


def _wrong_style(row: Any) -> str:
    return "bad" if any(status in row["statuses"] for status in _TROUBLE) else "odd"


def _time(name: str) -> Any:
    return lambda row: cells.milliseconds((row["response_time"] or {}).get(name))


def _last(row: Any, board: Board) -> Carried | str:
    return "" if row["last"] is None else Carried(row["last"], board.look.address)
