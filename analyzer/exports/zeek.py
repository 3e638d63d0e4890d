"""Zeek's `modbus.log`: a line for each PDU, tab-separated or JSON, made in the core."""

from __future__ import annotations

from collections.abc import Callable, Iterable

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

    def encoder(self) -> Callable[[_modlens.Table], Iterable[bytes]]:
        """What encodes the next rows; the first one puts the header before them."""
        header, self._header_written = not self._header_written, True
        json = self.options.style == "json"
        return lambda table: (table.zeek(self.log, json=json, header=header),)

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode rows; the first time the header comes before them."""
        return b"".join(self.encoder()(table))
