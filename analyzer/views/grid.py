"""A small table for the terminal: statistics, registers, live values.

The tables of rows are drawn by the core (row_lines.py). A number that is wider than its column
pushes the rest of its line to the right; a text is cut off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import _modlens
from analyzer.views.screen import Part, fit, width_of

__all__ = ["WIDE_COLUMNS", "Cell", "ColumnLayout", "Grid", "GridColumn", "RegisterValues"]

WIDE_COLUMNS = 120
"""From this terminal width on, columns are two spaces apart and longer names are used."""


class RegisterValues(NamedTuple):
    """The register values of a transaction, shown as far as they fit: `555 0 100 … +12`."""

    row: _modlens.Row
    base: str

    def within(self, width: int) -> str:
        """As many values as fit into `width` columns, and how many more there are."""
        return _modlens.carried(self.row, self.base, max(width, 0))


Cell = str | RegisterValues


class ColumnLayout(NamedTuple):
    """Title, widths and alignment of a column, and its share of the width that is left.

    Without `max_width` and `free_share` (both 0), or with `is_whole`, nothing in the column is cut
    off: a cell wider than the column pushes its line to the right. A column that `gives_way` is as
    narrow as `min_width` where the terminal has no room.
    """

    title: str
    min_width: int = 1
    align_right: bool = False
    max_width: int = 0
    free_share: int = 0
    is_whole: bool = False
    gives_way: bool = False

    def width(self, widest: int) -> int:
        """The width for the title and the widest cell, without a share of what is left."""
        min_width = max(self.min_width, width_of(self.title))
        if self.free_share:
            return min_width
        return max(min_width, min(widest, self.max_width) if self.max_width else widest)


class GridColumn(NamedTuple):
    """A column of a grid: its layout, and the text and style (in `STYLES`) of a row's cell."""

    head: ColumnLayout
    cell: Callable[[Any], Cell]
    style: Callable[[Any], str] = lambda _: ""


class Grid:
    """Lays out a table: fixes the widths of its columns and makes its lines.

    `rows` are the first rows, which decide the widths; `width` is that of the terminal.
    """

    def __init__(self, fields: Sequence[GridColumn], rows: Iterable[Any], width: int) -> None:
        self._fields = fields
        self._gap = "  " if width >= WIDE_COLUMNS else " "
        widest = _widest(fields, rows)
        self._widths = [field.head.width(cell) for field, cell in zip(fields, widest, strict=True)]
        rest = width - sum(self._widths) - len(self._gap) * (len(fields) - 1)
        for index, field in reversed(list(enumerate(fields))):
            if field.head.gives_way and rest < 0:
                given = min(-rest, self._widths[index] - field.head.min_width)
                self._widths[index] -= given
                rest += given
        shares = sum(field.head.free_share for field in fields)
        for index, field in enumerate(fields):
            free_share = field.head.free_share
            if free_share and rest > 0:
                taken = rest * free_share // shares
                self._widths[index] += taken
                rest, shares = rest - taken, shares - free_share

    def head(self) -> list[Part]:
        """The line of titles."""
        return self._join([(field.head.title, "head") for field in self._fields])

    def line(self, row: Any) -> list[Part]:
        """One row as parts to print."""
        return self._join([(field.cell(row), field.style(row)) for field in self._fields])

    def _join(self, cells: Sequence[tuple[Cell, str]]) -> list[Part]:
        parts: list[Part] = []
        for field, width, (cell, style) in zip(self._fields, self._widths, cells, strict=True):
            parts.append((_fitted(cell, field.head, width), style))
            parts.append((self._gap, ""))
        return parts[:-1]


def _widest(fields: Sequence[GridColumn], rows: Iterable[Any]) -> list[int]:
    """The width of the widest cell of each column; the rows are gone through once."""
    widest = [0] * len(fields)
    measured = [(at, field) for at, field in enumerate(fields) if not field.head.free_share]
    for row in rows:
        for at, field in measured:
            cell = field.cell(row)
            if isinstance(cell, str):
                widest[at] = max(widest[at], width_of(cell))
    return widest


def _fitted(cell: Cell, head: ColumnLayout, width: int) -> str:
    text = cell if isinstance(cell, str) else cell.within(width)
    if len(text) <= width and text.isascii():
        return text.rjust(width) if head.align_right else text.ljust(width)
    is_whole = head.is_whole or not (head.free_share or head.max_width)
    if width_of(text) > width and is_whole:
        return text
    return fit(text, width, right=head.align_right)
