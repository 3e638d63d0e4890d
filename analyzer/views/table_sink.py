"""The annotated table of one kind of rows, printed while it grows; see `analyzer.session.Sink`."""

from __future__ import annotations

from itertools import islice

import _modlens
from analyzer.filters import parse
from analyzer.views.row_lines import Look, lines
from analyzer.views.screen import Screen

__all__ = ["TableSink"]

SAMPLE = 500
"""Rows that decide the widths."""

AT_ONCE = 1000
"""Rows that are printed with one write."""


class TableSink:
    """Prints the rows of one table on a screen; `where` is the text of a filter (`FilterError`)."""

    name = "standard output"

    def __init__(self, table: str, screen: Screen, look: Look, *, where: str | None = None) -> None:
        self.table = table
        self.rows = 0
        self._screen = screen
        self._look = look
        self._predicate = None if where is None else parse(where, table).predicate()
        self._lines: _modlens.Lines | None = None

    def put(self, batch: _modlens.Batch) -> None:
        """Print the batch's rows."""
        table: _modlens.Table = getattr(batch, self.table)
        if self._predicate is not None:
            table = table.where(self._predicate)
        self.show(table)

    def show(self, table: _modlens.Table) -> None:
        """Print these rows."""
        count = len(table)
        if not count:
            return
        self.rows += count
        if self._lines is None:
            self._lines = lines(list(islice(table, SAMPLE)), self._look, self._screen.width)
        for start in range(0, count, AT_ONCE):
            if self._screen.is_plain:
                self._screen.text(self._lines.text(table, start, AT_ONCE))
            else:
                self._screen.lines(self._lines.parts(table, start, AT_ONCE))

    def close(self) -> None:
        """Nothing to do: every line has been printed."""

    def abandon(self) -> None:
        """Nothing to do: what is printed is printed."""
