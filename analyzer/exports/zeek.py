"""Zeek's `modbus.log`: a line for each PDU, tab-separated or JSON, made in the core."""

from __future__ import annotations

import _modlens
from analyzer import exports

__all__ = ["Format"]


class Format(exports.Format):
    """A log in Zeek's format."""

    log = "modbus"
    tables = ("transactions",)
    styles = ("tsv", "json")
    has_column_choice = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._header_written = False

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode rows; the first time the header comes before them."""
        header, self._header_written = not self._header_written, True
        return table.zeek(self.log, json=self.options.style == "json", header=header)
