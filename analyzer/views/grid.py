"""A small table for the terminal: statistics, registers, live values.

The tables of rows are drawn by the core (row_lines.py). A number that is wider than its column
pushes the rest of its line to the right; a text is cut off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import _modlens
from analyzer.views.screen import Part, fit, width_of

__all__ = [
    "WIDE_COLUMNS",
    "Cell",
    "ColumnLayout",
    "Grid",
    "GridColumn",
    "NamedValues",
    "RegisterValues",
]

WIDE_COLUMNS = 120
"""From this terminal width on, columns are two spaces apart and longer names are used."""


class RegisterValues(NamedTuple):
    """The register values of a transaction, shown as far as they fit: `555 0 100 … +12`."""

    row: _modlens.Row
    base: str

    def within(self, width: int) -> str:
        """As many values as fit into `width` columns, and how many more there are."""
        return _modlens.carried(self.row, self.base, max(width, 0))


class NamedValues(NamedTuple):
    """Named values, shown as far as they fit: with their names, or where none fits, without."""

    texts: Sequence[tuple[str, str]]

    def within(self, width: int) -> str:
        """As many values as fit into `width` columns, and how many more there are.

        >>> values = NamedValues([("voltage_l1", "230.6"), ("voltage_l2", "231.4")])
        >>> [values.within(width) for width in (40, 24, 12, 5)]
        ['voltage_l1 230.6, voltage_l2 231.4', 'voltage_l1 230.6 … +1', '230.6 231.4', '230.6']
        """
        named = [f"{name} {value}" for name, value in self.texts]
        bare = [value for _, value in self.texts]
        for texts, separator in ((named, ", "), (bare, " ")):
            for count in range(len(texts), 0, -1):
                more = len(texts) - count
                text = separator.join(texts[:count]) + (f" … +{more}" if more else "")
                if width_of(text) <= width:
                    return text
        return bare[0] if bare else ""


Cell = str | RegisterValues | NamedValues


class ColumnLayout(NamedTuple):
    """Title, widths and alignment of a column, and its share of the width that is left.

    Without `max_width` and `free_share` (both 0), or with `is_whole`, nothing in the column is cut
    off: a cell wider than the column pushes its line to the right. A column that `gives_way` is as
    narrow as `min_width` where the terminal has no room. Where that is not enough, columns are left
    out: that with the highest `spare` first, those with 0 never.
    """

    title: str
    min_width: int = 1
    align_right: bool = False
    max_width: int = 0
    free_share: int = 0
    is_whole: bool = False
    gives_way: bool = False
    spare: int = 0

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
        self._gap = "  " if width >= WIDE_COLUMNS else " "
        columns = list(zip(fields, _widest(fields, rows), strict=True))
        while (rest := self._rest(columns, width)) < 0:
            spare = max(columns, key=lambda column: column[0].head.spare)
            given = sum(_given(field, widest) for field, widest in columns)
            if not spare[0].head.spare or given >= -rest:
                break
            columns.remove(spare)
        self._fields = [field for field, _ in columns]
        self._widths = [field.head.width(widest) for field, widest in columns]
        for index, (field, widest) in reversed(list(enumerate(columns))):
            given = max(min(-rest, _given(field, widest)), 0)
            self._widths[index] -= given
            rest += given
        self._share([widest for _, widest in columns], rest)

    def _rest(self, columns: Sequence[tuple[GridColumn, int]], width: int) -> int:
        """The width that these columns leave of a terminal's; below 0 where it has no room."""
        taken = sum(field.head.width(widest) for field, widest in columns)
        return width - taken - len(self._gap) * (len(columns) - 1)

    def _share(self, widest: Sequence[int], rest: int) -> None:
        """Give what is left to the columns with a share; more than its text only to the last."""
        shares = sum(field.head.free_share for field in self._fields)
        for index, field in enumerate(self._fields):
            free_share = field.head.free_share
            if free_share and rest > 0:
                taken = rest * free_share // shares
                if index + 1 < len(self._fields):
                    taken = min(taken, max(widest[index] - self._widths[index], 0))
                self._widths[index] += taken
                rest, shares = rest - taken, shares - free_share

    @property
    def titles(self) -> list[str]:
        """The titles of the columns that have room."""
        return [field.head.title for field in self._fields]

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


def _given(field: GridColumn, widest: int) -> int:
    """How many columns a field can do without."""
    head = field.head
    return head.width(widest) - head.min_width if head.gives_way else 0


def _widest(fields: Sequence[GridColumn], rows: Iterable[Any]) -> list[int]:
    """The width of the widest cell of each column; the rows are gone through once.

    What is in the last column with a share does not matter: it takes all that is left.
    """
    widest = [0] * len(fields)
    measured = [
        (at, field)
        for at, field in enumerate(fields)
        if not field.head.free_share or at + 1 < len(fields)
    ]
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
