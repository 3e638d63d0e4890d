"""The table as shown on the screen, as a text file of 100 columns."""

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
    """The table of `modlens decode`."""

    has_column_choice = False
    before = after = ""

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._text = io.StringIO(self.before)
        self._text.seek(0, io.SEEK_END)
        table_options = TableOptions(options.address, options.times, tuple(options.buses))
        self._table = TableSink(options.table, Screen(self._text, width=WIDTH), table_options)

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode rows; the first time the column titles come before them."""
        self._table.show(table)
        text = self._text.getvalue()
        self._text.seek(0)
        self._text.truncate()
        return text.encode()

    def footer(self) -> bytes:
        """The end of the table."""
        return (self._text.getvalue() + self.after).encode()
