"""InfluxDB line protocol in the names of Telegraf's Modbus plugin.

The table `readings` becomes the measurement `modbus`, `transactions` becomes `modbus_transaction`.
"""

from __future__ import annotations

import _modlens
from analyzer import exports
from analyzer.exports.output import Output
from dissectors.errors import SourceError

__all__ = ["Format"]


class Format(exports.Format):
    """Line protocol of one table."""

    tables = ("transactions", "readings")
    has_column_choice = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._left_out = 0
        self._name = ""
        self._is_empty = True

    def output(self, path: str | None, *, growing: bool) -> Output:
        """Open the output; its name is kept for the error of `footer`."""
        output = super().output(path, growing=growing)
        self._name = output.name
        return output

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode the rows that have a date and time."""
        data, left_out = table.influx()
        self._left_out += left_out
        self._is_empty = self._is_empty and not data
        return data

    def footer(self) -> bytes:
        """Nothing; `SourceError` where rows came, but none with a time: the file would be empty."""
        if self._is_empty and self._left_out:
            raise SourceError(
                f"{self._name}: no row has a UTC time, which line protocol needs; --timezone and"
                " --date make times of a log UTC"
            )
        return b""

    def closing_remark(self) -> str:
        """How many rows had no date and time and were left out."""
        rows = "row" if self._left_out == 1 else "rows"
        return f"{self._left_out:,} {rows} without date and time skipped" if self._left_out else ""
