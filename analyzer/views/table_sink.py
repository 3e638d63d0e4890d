"""The sink that prints the rows of one table as they are decoded."""

from __future__ import annotations

from itertools import islice

import _modlens
from analyzer.views.row_lines import TableOptions, lines
from analyzer.views.screen import Screen

__all__ = ["TableSink"]

SAMPLE_ROWS = 500
"""Rows by which the widths of the columns are decided."""

ROWS_PER_WRITE = 1000
"""Rows that are printed with one call."""


class TableSink:
    """Prints the rows of one table on a screen; see `analyzer.pump.Sink`.

    `where` is the text of a filter; `FilterError` if it is not valid. At most `limit` rows are
    printed.
    """

    name = "standard output"

    def __init__(
        self,
        table: str,
        screen: Screen,
        table_options: TableOptions,
        *,
        where: str | None = None,
        limit: int | None = None,
    ) -> None:
        self.table = table
        self.row_count = 0
        self._limit = limit
        self._screen = screen
        self._table_options = table_options
        self._predicate = None
        if where is not None:
            from analyzer.filters import parse  # noqa: PLC0415 - loaded where there is a filter

            self._predicate = parse(where, table).predicate()
        self._lines: _modlens.Lines | None = None

    def put(self, batch: _modlens.Batch) -> None:
        """Print the rows of a batch."""
        table: _modlens.Table = getattr(batch, self.table)
        if self._predicate is not None:
            table = table.where(self._predicate)
        if self._limit is not None:
            table = table.slice(0, self._limit - self.row_count)
        self.show(table)

    @property
    def is_full(self) -> bool:
        """Whether `limit` rows have been printed."""
        return self.row_count == self._limit

    def show(self, table: _modlens.Table) -> None:
        """Print these rows."""
        count = len(table)
        if not count:
            return
        self.row_count += count
        if self._lines is None:
            self._lines = lines(
                list(islice(table, SAMPLE_ROWS)), self._table_options, self._screen.width
            )
        for start in range(0, count, ROWS_PER_WRITE):
            if self._screen.is_plain:
                self._screen.text(self._lines.text(table, start, ROWS_PER_WRITE))
            else:
                self._screen.lines(self._lines.parts(table, start, ROWS_PER_WRITE))

    def close(self) -> None:
        """Nothing to do: every line has been printed."""

    def rollback(self) -> None:
        """Nothing to do: printed lines cannot be taken back."""
