"""The annotated table of one kind of rows, printed while it grows; see `analyzer.session.Sink`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import _modlens
from analyzer.filters import parse
from analyzer.views.grid import ROOMY, Grid
from analyzer.views.moments import Moments
from analyzer.views.screen import Part, Screen
from analyzer.views.tables import Look, fields

__all__ = ["TableSink"]

SAMPLE = 500
"""Rows that decide the widths."""

AT_ONCE = 1000
"""Lines that are printed with one write."""


class TableSink:
    """Prints the rows of one table on a screen; `where` is the text of a filter (`FilterError`)."""

    name = "standard output"

    def __init__(self, table: str, screen: Screen, look: Look, *, where: str | None = None) -> None:
        self.table = table
        self.rows = 0
        self._screen = screen
        self._look = look
        self._predicate = None if where is None else parse(where, table).predicate()
        self._grid: Grid | None = None
        self._moments: Moments | None = None

    def put(self, batch: _modlens.Batch) -> None:
        """Print the batch's rows."""
        table: _modlens.Table = getattr(batch, self.table)
        if self._predicate is not None:
            table = table.where(self._predicate)
        self.show(table)

    def show(self, table: _modlens.Table) -> None:
        """Print these rows."""
        if not len(table):
            return
        self.rows += len(table)
        lines = self._lines(table)
        while chunk := list(islice(lines, AT_ONCE)):
            self._screen.lines(chunk)

    def close(self) -> None:
        """Nothing to do: every line has been printed."""

    def abandon(self) -> None:
        """Nothing to do: what is printed is printed."""

    def _lines(self, table: _modlens.Table) -> Iterator[list[Part]]:
        if self._grid is None or self._moments is None:
            width = self._screen.width
            sample = list(islice(table, SAMPLE))
            self._moments = Moments(self._look.times, sample, digits=6 if width >= ROOMY else 3)
            chosen = fields(self.table, self._look, sample, width, self._moments)
            self._grid = Grid(chosen, sample, width)
            yield self._grid.head()
        for row in table:
            day = self._moments.day(row)
            if day is not None:
                yield [(day, "dim")]
            yield [(self._grid.text(row), "")] if self._screen.is_plain else self._grid.line(row)
            self._moments.advance(row)
