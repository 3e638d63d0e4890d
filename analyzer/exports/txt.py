"""The table as people see it on the screen, as a text file, 100 columns wide."""

from __future__ import annotations

import io

import _modlens
from analyzer import exports
from analyzer.views.row_lines import TableOptions
from analyzer.views.screen import Screen
from analyzer.views.table_sink import TableSink

__all__ = ["Format"]

WIDTH = 100


class Format(exports.Format):
    """The annotated table."""

    has_column_choice = False
    before = after = ""

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._text = io.StringIO(self.before)
        self._text.seek(0, io.SEEK_END)
        table_options = TableOptions(options.address, options.times, tuple(options.buses))
        self._table = TableSink(options.table, Screen(self._text, width=WIDTH), table_options)

    def encode(self, table: _modlens.Table) -> bytes:
        """The rows, behind the head the first time."""
        self._table.show(table)
        text = self._text.getvalue()
        self._text.seek(0)
        self._text.truncate()
        return text.encode()

    def footer(self) -> bytes:
        """What ends the table."""
        return (self._text.getvalue() + self.after).encode()
