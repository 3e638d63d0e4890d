"""Registers as tables: the map as last seen, and one place read as every type there is."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from analyzer.addresses import SHORT, render
from analyzer.views.cells import BASE_TITLES
from analyzer.views.grid import Field, Grid, Head
from analyzer.views.screen import Screen, visible

__all__ = ["show_grid", "show_map"]


def show_map(
    rows: Sequence[Mapping[str, Any]], screen: Screen, base: str, *, as_json: bool
) -> None:
    """The register map; rows are those of `_modlens.RegisterMap`."""
    if as_json:
        screen.lines([[(json.dumps(row, ensure_ascii=False), "")] for row in rows])
        return
    fields = [
        Field(Head("unit", 4, right=True), lambda row: str(row["unit"])),
        Field(Head("type", 4), lambda row: SHORT[row["register_type"]]),
        Field(
            Head(BASE_TITLES[base], 6, right=True),
            lambda row: render(row["address"], row["register_type"], base),
        ),
        Field(Head("name", 4, most=28), lambda row: visible(row["name"] or "")),
        Field(Head("value", 8, most=24), lambda row: visible(_value(row)), _named),
        Field(Head("min", 3, right=True), lambda row: _figure(row["min"])),
        Field(Head("max", 3, right=True), lambda row: _figure(row["max"])),
        Field(Head("seen", 4, right=True), lambda row: str(row["count"])),
        Field(Head("changes", 7, right=True), lambda row: str(row["changes"])),
    ]
    if any(row["age_us"] is not None for row in rows):
        fields.append(Field(Head("age s", 6, right=True), _age))
    if len({row["bus"] for row in rows}) > 1:
        fields.insert(0, Field(Head("bus", 3, most=24), lambda row: visible(row["bus"])))
    show_grid(fields, rows, screen)


def show_grid(fields: Sequence[Field], rows: Sequence[Any], screen: Screen) -> None:
    """A whole table at once."""
    grid = Grid(fields, rows, screen.width)
    screen.lines([grid.head(), *(grid.line(row) for row in rows)])


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
