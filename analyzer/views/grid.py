"""A small table: statistics, registers. The tables of rows are the core's (`views/tables.py`).

A number that is wider than its column pushes its line, a text is cut.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import _modlens
from analyzer.views.screen import Part, fit, width_of

__all__ = ["ROOMY", "Carried", "Cell", "Field", "Grid", "Head"]

ROOMY = 120
"""From this width on: two spaces between columns, longer names."""


@dataclass(frozen=True, slots=True)
class Carried:
    """The values of a transaction, shown as far as they fit: `555 0 100 … +12`."""

    row: _modlens.Row
    base: str

    def within(self, width: int) -> str:
        """As many values as fit, and how many more there are."""
        return _modlens.carried(self.row, self.base, max(width, 0))


Cell = str | Carried


@dataclass(frozen=True, slots=True)
class Head:
    """A column: its title, its least and greatest width, its side, and its share of free room.

    Without `most` and `share` (both 0) nothing in the column is cut: what is wider than the first
    rows were pushes its line to the right.
    """

    title: str
    least: int = 1
    right: bool = False
    most: int = 0
    share: int = 0

    def width(self, cells: Iterable[Cell]) -> int:
        """The columns for the title and these cells, without any share."""
        least = max(self.least, width_of(self.title))
        if self.share:
            return least
        widest = max((width_of(cell) for cell in cells if isinstance(cell, str)), default=0)
        return max(least, min(widest, self.most) if self.most else widest)


@dataclass(frozen=True, slots=True)
class Field:
    """A column of a grid: its head, its cell for a row, and that cell's style (in `STYLES`)."""

    head: Head
    cell: Callable[[Any], Cell]
    style: Callable[[Any], str] = lambda _: ""


class Grid:
    """The widths of a table's columns, and its lines.

    `rows` are the first rows, `width` the columns of the terminal.
    """

    def __init__(self, fields: Sequence[Field], rows: Sequence[Any], width: int) -> None:
        self._fields = fields
        self._gap = "  " if width >= ROOMY else " "
        self._widths = [field.head.width(field.cell(row) for row in rows) for field in fields]
        rest = width - sum(self._widths) - len(self._gap) * (len(fields) - 1)
        shares = sum(field.head.share for field in fields)
        for index, field in enumerate(fields):
            share = field.head.share
            if share and rest > 0:
                taken = rest * share // shares
                self._widths[index] += taken
                rest, shares = rest - taken, shares - share

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


def _fitted(cell: Cell, head: Head, width: int) -> str:
    text = cell if isinstance(cell, str) else cell.within(width)
    if len(text) <= width and text.isascii():
        return text.rjust(width) if head.right else text.ljust(width)
    if width_of(text) > width and not (head.share or head.most):
        return text
    return fit(text, width, right=head.right)
