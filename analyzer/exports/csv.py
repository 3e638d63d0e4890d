"""CSV (RFC 4180): a line of column names, then a line for each row.

Lists are joined by single spaces, null is empty. A cell that a spreadsheet would take for a formula
is neutralized. The text is made in the core.
"""

from __future__ import annotations

from collections.abc import Iterable

import _modlens
from analyzer import exports

__all__ = ["Format"]


class Format(exports.Format):
    """CSV of some columns of one table."""

    name = "csv"

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._header_written = False

    def encode_blocks(self, table: _modlens.Table) -> Iterable[bytes]:
        """Encode rows; the first time the line of column names comes before them."""
        header, self._header_written = not self._header_written, True
        return table.lines(self.name, self.options.columns, header=header)

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode rows in one block."""
        return b"".join(self.encode_blocks(table))
