"""Registers as tables: the register map, and registers interpreted as every type."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

from analyzer.addresses import SHORT, render
from analyzer.views.cells import BASE_TITLES
from analyzer.views.grid import WIDE_COLUMNS, ColumnLayout, Grid, GridColumn
from analyzer.views.screen import Screen, visible

__all__ = ["show_grid", "show_map"]


def show_map(
    rows: Iterable[Mapping[str, Any]], screen: Screen, base: str, *, as_json: bool
) -> None:
    """Print the register map; `rows` are those of `_modlens.RegisterMap`, gone through thrice."""
    if as_json:
        screen.lines([(json.dumps(row, ensure_ascii=False), "")] for row in rows)
        return
    has_names, has_ages, buses = False, False, set()
    for row in rows:
        has_names |= bool(row["name"])
        has_ages |= row["age_us"] is not None
        buses.add(row["bus"])
    changes = "changes" if screen.width >= WIDE_COLUMNS else "chg"
    fields = [
        GridColumn(ColumnLayout("unit", 4, align_right=True), lambda row: str(row["unit"])),
        GridColumn(ColumnLayout("type", 4), lambda row: SHORT[row["register_type"]]),
        GridColumn(
            ColumnLayout(BASE_TITLES[base], 6, align_right=True),
            lambda row: render(row["address"], row["register_type"], base),
        ),
        GridColumn(
            ColumnLayout("value", 8, max_width=24, is_whole=True, gives_way=True),
            lambda row: visible(_value(row)),
            _named,
        ),
        GridColumn(ColumnLayout("min", 3, align_right=True), lambda row: _figure(row["min"])),
        GridColumn(ColumnLayout("max", 3, align_right=True), lambda row: _figure(row["max"])),
        GridColumn(
            ColumnLayout("seen", 4, align_right=True, spare=3), lambda row: str(row["count"])
        ),
        GridColumn(
            ColumnLayout(changes, 3, align_right=True, spare=2), lambda row: str(row["changes"])
        ),
    ]
    if has_names:
        layout = ColumnLayout("name", 12, max_width=28, gives_way=True)
        fields.insert(3, GridColumn(layout, lambda row: visible(row["name"] or "")))
    if has_ages:
        fields.append(GridColumn(ColumnLayout("age s", 6, align_right=True, spare=1), _age))
    if len(buses) > 1:
        fields.insert(
            0, GridColumn(ColumnLayout("bus", 3, max_width=24), lambda row: visible(row["bus"]))
        )
    show_grid(fields, rows, screen)


def show_grid(fields: Sequence[GridColumn], rows: Iterable[Any], screen: Screen) -> None:
    """Print a whole table."""
    grid = Grid(fields, rows, screen.width)
    screen.lines(chain([grid.head()], map(grid.line, rows)))


def _value(row: Mapping[str, Any]) -> str:
    text = "-" if row["value_text"] is None else row["value_text"]
    return " ".join(filter(None, (text, row["unit_of_measure"])))


def _named(row: Mapping[str, Any]) -> str:
    return "good" if row["name"] else ""


def _figure(number: float | None) -> str:
    if number is None:
        return ""
    return str(int(number)) if float(number).is_integer() else f"{number:.6g}"


def _age(row: Mapping[str, Any]) -> str:
    return "" if row["age_us"] is None else f"{row['age_us'] / 1e6:.1f}"
