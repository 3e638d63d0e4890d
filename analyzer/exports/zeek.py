"""Zeek's `modbus.log`: a line a PDU, tab-separated or JSON; the lines are the core's."""

from __future__ import annotations

import _modlens
from analyzer import exports

__all__ = ["Format"]


class Format(exports.Format):
    """A log in Zeek's form."""

    log = "modbus"
    tables = ("transactions",)
    styles = ("tsv", "json")
    has_column_choice = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._header_written = False

    def encode(self, table: _modlens.Table) -> bytes:
        """The lines, behind the header the first time."""
        header, self._header_written = not self._header_written, True
        return table.zeek(self.log, json=self.options.style == "json", header=header)
