"""An Excel workbook (extra `xlsx`): a sheet of rows, and one that explains the columns.

Times are numbers that Excel shows as times, in UTC. A sheet holds 1,048,576 lines, so rows go on in
a second one. Texts stay texts: none becomes a formula or a link.
"""

from __future__ import annotations

import io
import math
import shutil
import tempfile
from collections.abc import Callable
from datetime import date, datetime
from functools import cache
from typing import Any

import _modlens
from analyzer import exports
from analyzer.columns import Column, columns
from analyzer.exports.output import Output
from analyzer.installing import how_to_install
from dissectors.errors import SourceError, UsageError

__all__ = ["Format"]

MAX_LINES = 1_048_576
"""Lines of a sheet, with that of the column names."""

MAX_CHARACTERS = 32_767
"""Characters of a cell."""

ROWS_AT_ONCE = 1000
CREATED = datetime(2000, 1, 1)
FIRST_DAY = date(1899, 12, 30).toordinal()
"""Day 0 of Excel's calendar, which counts a day that 1900 did not have."""

WIDTHS = {"time": 24, "text": 18, "texts": 18, "hex": 24, "ints": 24, "map": 24}
"""Type of a column -> its width in characters."""


class Format(exports.Format):
    """A workbook of some columns of one table."""

    readable_while_written = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        by_key = {column.key: column for column in columns(options.table)}
        self._columns = [by_key[key] for key in options.columns]
        self._max_lines = MAX_LINES
        self._cut_cells = 0
        self._folder: str | None = None
        self._workbook: Any = None
        self._sheet: Any = None
        self._sheets = 0
        self._line = 0

    def output(self, path: str | None, *, growing: bool) -> Output:
        """Open the file; its rows are in a temporary folder until it is complete."""
        writer = _xlsxwriter()
        inner = super().output(path, growing=growing)
        self._folder = tempfile.mkdtemp(prefix="modlens-")
        self._bytes = io.BytesIO()
        options = {"constant_memory": True, "tmpdir": self._folder, "use_zip64": True}
        self._workbook = writer.Workbook(self._bytes, options)
        self._workbook.set_properties({"created": CREATED, "comments": "Times are in UTC."})
        self._head = self._workbook.add_format({"bold": True})
        self._time = self._workbook.add_format({"num_format": "yyyy-mm-dd hh:mm:ss.000"})
        self._begin_sheet()
        return _TemporaryOutput(inner, self._discard)

    def encode(self, table: _modlens.Table) -> bytes:
        """Add rows; their bytes come with the `footer`."""
        for start in range(0, len(table), ROWS_AT_ONCE):
            for row in table.tuples(self.options.columns, start, ROWS_AT_ONCE):
                if self._line == self._max_lines:
                    self._begin_sheet()
                for at, (column, value) in enumerate(zip(self._columns, row, strict=True)):
                    if value is not None and value != "":
                        self._put(at, column.type, value)
                self._line += 1
        return b""

    def footer(self) -> bytes:
        """The whole workbook."""
        self._end_sheet()
        self._explain_columns()
        try:
            self._workbook.close()
        except OSError as error:
            raise SourceError(f"xlsx: the workbook cannot be put together: {error}") from error
        finally:
            self._discard()
        return self._bytes.getvalue()

    def closing_remark(self) -> str:
        """What a reader of the workbook has to know of its limits."""
        remarks = []
        if self._sheets > 1:
            remarks.append(f"{self._sheets} sheets, since Excel has {MAX_LINES:,} lines in one")
        if self._cut_cells:
            remarks.append(f"{self._cut_cells} cells cut at Excel's {MAX_CHARACTERS:,} characters")
        return "; ".join(remarks)

    def _begin_sheet(self) -> None:
        if self._sheets:
            self._end_sheet()
        self._sheets += 1
        name = self.options.table if self._sheets == 1 else f"{self.options.table} {self._sheets}"
        self._sheet = self._workbook.add_worksheet(name)
        self._sheet.freeze_panes(1, 0)
        for at, column in enumerate(self._columns):
            self._sheet.set_column(at, at, WIDTHS.get(column.type, 12))
            self._sheet.write_string(0, at, column.key, self._head)
        self._line = 1

    def _end_sheet(self) -> None:
        self._sheet.autofilter(0, 0, self._line - 1, len(self._columns) - 1)

    def _put(self, at: int, kind: str, value: Any) -> None:
        if kind == "time":
            serial = excel_time(value)
            if serial is not None:
                self._sheet.write_number(self._line, at, serial, self._time)
                return
        elif kind == "bool":
            self._sheet.write_boolean(self._line, at, bool(value))
            return
        elif isinstance(value, int | float) and math.isfinite(value):
            self._sheet.write_number(self._line, at, value)
            return
        text = str(value)
        if len(text) > MAX_CHARACTERS:
            self._cut_cells += 1
            text = text[:MAX_CHARACTERS]
        self._sheet.write_string(self._line, at, text)

    def _explain_columns(self) -> None:
        sheet = self._workbook.add_worksheet("columns")
        sheet.set_column(0, 0, 20)
        sheet.set_column(1, 1, 100)
        sheet.write_string(0, 0, "column", self._head)
        sheet.write_string(0, 1, "meaning", self._head)
        for at, column in enumerate(self._columns, 1):
            sheet.write_string(at, 0, column.key)
            sheet.write_string(at, 1, _meaning(column))

    def _discard(self) -> None:
        """Delete the temporary files, which are open if the workbook is not complete."""
        folder, self._folder = self._folder, None
        if folder is None:
            return
        for sheet in self._workbook.worksheets():
            sheet._opt_close()
        shutil.rmtree(folder, ignore_errors=True)


class _TemporaryOutput:
    """An output whose rollback also deletes the temporary files of the workbook."""

    def __init__(self, inner: Output, discard: Callable[[], None]) -> None:
        self.name, self.remark = inner.name, inner.remark
        self._inner = inner
        self._discard = discard

    def append(self, data: bytes) -> None:
        """Append these bytes."""
        self._inner.append(data)

    def close(self, *, interrupted: bool = False) -> None:
        """Complete the file."""
        self._inner.close(interrupted=interrupted)
        self.name, self.remark = self._inner.name, self._inner.remark

    def rollback(self) -> None:
        """Discard the file and the temporary ones."""
        self._discard()
        self._inner.rollback()


def excel_time(text: str) -> float | None:
    """Returns a time as Excel counts it, in days; None for one before 1900.

    >>> excel_time("2026-11-21T12:00:00.5Z")
    46347.500005787035
    """
    if text < "1900-03-01":
        return None
    seconds = int(text[11:13]) * 3600 + int(text[14:16]) * 60 + float(text[17:-1])
    return _day(text[:10]) + seconds / 86400


@cache
def _day(text: str) -> int:
    return date.fromisoformat(text).toordinal() - FIRST_DAY


def _meaning(column: Column) -> str:
    return f"{column.help} (UTC)" if column.type == "time" else column.help


def _xlsxwriter() -> Any:
    try:
        import xlsxwriter  # noqa: PLC0415 - an extra, loaded where it is used
    except ImportError:
        raise UsageError(f"xlsx needs a package: {how_to_install('XlsxWriter')}") from None
    return xlsxwriter
