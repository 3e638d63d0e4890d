"""CSV (RFC 4180): a line of column names, then a line for each row.

Lists are joined by single spaces, null is empty. A cell that a spreadsheet would take for a formula
is neutralized. The text is made in the core.

The style `excel` is for spreadsheets: it begins with a byte order mark, without which Excel takes
UTF-8 for something else, and its times are `2026-11-21 11:12:56.644`, which Excel reads as times
(UTC, to the millisecond: it takes finer ones for text).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar

import _modlens
from analyzer import exports
from analyzer.columns import columns

__all__ = ["Format"]


class Format(exports.Format):
    """CSV of some columns of one table."""

    name = "csv"
    styles: ClassVar[Sequence[str]] = ("plain", "excel")

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._header_written = False
        self._lines = _modlens.LineEncoder(self.name, options.table, options.columns)
        times = {column.key for column in columns(options.table) if column.type == "time"}
        self._times = [at for at, key in enumerate(options.columns) if key in times]

    def encoder(self) -> Callable[[_modlens.Table], Iterable[bytes]]:
        """What encodes the next rows; the first one puts the line of column names before them."""
        header = self._begin()
        if self.options.style == "excel":
            return lambda table: (self._for_excel(table, header=header),)
        return lambda table: self._lines.pieces(table, header=header)

    def encode_blocks(self, table: _modlens.Table) -> Iterable[bytes]:
        """Encode rows, the first time with the line of column names."""
        if self.options.style == "excel":
            return (self._for_excel(table, header=self._begin()),)
        return self._lines.pieces(table, header=self._begin())

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode rows in one block."""
        return b"".join(self.encode_blocks(table))

    def _begin(self) -> bool:
        """Whether the header has to come now."""
        header, self._header_written = not self._header_written, True
        return header

    def _for_excel(self, table: _modlens.Table, *, header: bool) -> bytes:
        """Rows with times as Excel reads them."""
        plain = b"".join(self._lines.pieces(table, header=header)).decode()
        found = io.StringIO(newline="")
        writer = csv.writer(found)
        for row in csv.reader(io.StringIO(plain, newline="")):
            for at in self._times:
                if row[at].endswith("Z"):
                    row[at] = row[at][:23].removesuffix("Z").replace("T", " ")
            writer.writerow(row)
        return found.getvalue().encode("utf-8-sig" if header else "utf-8")
