"""InfluxDB line protocol in the names of Telegraf's Modbus plugin.

The table `readings` becomes the measurement `modbus`, `transactions` becomes `modbus_transaction`.
"""

from __future__ import annotations

import _modlens
from analyzer import exports

__all__ = ["Format"]


class Format(exports.Format):
    """Line protocol of one table."""

    tables = ("transactions", "readings")
    has_column_choice = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._left_out = 0

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode the rows that have a date and time."""
        data, left_out = table.influx()
        self._left_out += left_out
        return data

    def closing_remark(self) -> str:
        """How many rows had no date and time and were left out."""
        return f"{self._left_out:,} rows without date and time skipped" if self._left_out else ""
