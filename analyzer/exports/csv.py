"""CSV (RFC 4180): a line of column names, then a line for each row.

Lists are joined by single spaces, null is empty. A cell that a spreadsheet would take for a formula
is neutralized. The text is made in the core.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import _modlens
from analyzer import exports

__all__ = ["Format"]


class Format(exports.Format):
    """CSV of some columns of one table."""

    name = "csv"

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._header_written = False
        self._lines = _modlens.LineEncoder(self.name, options.table, options.columns)

    def encoder(self) -> Callable[[_modlens.Table], Iterable[bytes]]:
        """What encodes the next rows; the first one puts the line of column names before them."""
        header = self._begin()
        return lambda table: self._lines.pieces(table, header=header)

    def encode_blocks(self, table: _modlens.Table) -> Iterable[bytes]:
        """Encode rows, the first time with the line of column names."""
        return self._lines.pieces(table, header=self._begin())

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode rows in one block."""
        return b"".join(self.encode_blocks(table))

    def _begin(self) -> bool:
        """Whether the header has to come now."""
        header, self._header_written = not self._header_written, True
        return header
