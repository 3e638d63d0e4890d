"""CSV (RFC 4180): a line of column names, then a line a row.

Lists joined by single spaces, null empty. No cell from outside starts a spreadsheet's formula.

The text is the core's, so that it costs nothing per row here.
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
        """The rows, behind the line of names the first time."""
        header, self._header_written = not self._header_written, True
        return table.lines(self.name, self.options.columns, header=header)

    def encode(self, table: _modlens.Table) -> bytes:
        """All pieces at once."""
        return b"".join(self.encode_blocks(table))
