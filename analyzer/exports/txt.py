"""The table as people see it on the screen, as a text file, 100 columns wide."""

from __future__ import annotations

import io

import _modlens
from analyzer import exports
from analyzer.views.row_lines import Look
from analyzer.views.screen import Screen
from analyzer.views.table_sink import TableSink

__all__ = ["Format"]

WIDTH = 100


class Format(exports.Format):
    """The annotated table."""

    chosen = False
    before = after = ""

    def __init__(self, wish: exports.Wish) -> None:
        super().__init__(wish)
        self._text = io.StringIO(self.before)
        self._text.seek(0, io.SEEK_END)
        look = Look(wish.address, wish.times, tuple(wish.buses))
        self._table = TableSink(wish.table, Screen(self._text, width=WIDTH), look)

    def rows(self, table: _modlens.Table) -> bytes:
        """The rows, behind the head the first time."""
        self._table.show(table)
        text = self._text.getvalue()
        self._text.seek(0)
        self._text.truncate()
        return text.encode()

    def end(self) -> bytes:
        """What ends the table."""
        return (self._text.getvalue() + self.after).encode()
