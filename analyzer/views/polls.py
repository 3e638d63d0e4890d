"""Draws what a master asks again and again: the requests of `stats`, and how often each comes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from analyzer.views import cells
from analyzer.views.grid import ColumnLayout, Grid, GridColumn
from analyzer.views.screen import Part

__all__ = ["polls"]

MOST = 12
"""Requests that are listed; a report lists all."""


def polls(bus: Mapping[str, Any], width: int) -> Iterator[list[Part]]:
    """The requests of a bus that came several times: those that take the most time first."""
    rows = [row for row in bus["polls"]["requests"] if row["interval"]]
    if not rows:
        return
    yield [("requests that come again, by their share of time", "head")]
    grid = Grid(_fields(bus["duration_us"]), rows[:MOST], width)
    yield grid.head()
    for row in rows[:MOST]:
        yield grid.line(row)
    if len(rows) > MOST:
        yield [(f"{len(rows) - MOST:,} more are in modlens report", "dim")]


def _fields(duration_us: float | None) -> Sequence[GridColumn]:
    def milliseconds(title: str, name: str, spare: int = 0) -> GridColumn:
        return GridColumn(
            ColumnLayout(title, 8, align_right=True, spare=spare),
            lambda row: cells.milliseconds(row["interval"][name]),
        )

    def share(row: Mapping[str, Any]) -> str:
        taken = row["taken_us"]
        return f"{taken / duration_us:.1%}" if taken is not None and duration_us else ""

    return (
        GridColumn(
            ColumnLayout("unit", 4, align_right=True), lambda row: cells.number(row["unit"])
        ),
        GridColumn(ColumnLayout("function", 12, free_share=1), cells.function_name),
        GridColumn(ColumnLayout("addresses", 11), _addresses),
        GridColumn(
            ColumnLayout("sent", 6, align_right=True, spare=1), lambda row: f"{row['count']:,}"
        ),
        milliseconds("every ms", "p50_us"),
        milliseconds("longest", "max_us", 2),
        GridColumn(ColumnLayout("of time", 7, align_right=True), share),
    )


def _addresses(row: Mapping[str, Any]) -> str:
    """The first and the last address of a request.

    >>> [_addresses({"address": a, "quantity": q}) for a, q in ((5, 1), (0, 10), (None, None))]
    ['5', '0-9', '']
    """
    first, quantity = row["address"], row["quantity"]
    if first is None:
        return ""
    return f"{first}-{first + quantity - 1}" if quantity and quantity > 1 else f"{first}"
