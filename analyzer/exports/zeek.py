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
    chosen = False

    def __init__(self, wish: exports.Wish) -> None:
        super().__init__(wish)
        self._begun = False

    def rows(self, table: _modlens.Table) -> bytes:
        """The lines, behind the header the first time."""
        header, self._begun = not self._begun, True
        return table.zeek(self.log, json=self.wish.style == "json", header=header)
