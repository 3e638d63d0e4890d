"""JSON lines: one object a row, null omitted, hex in lower case, times as ISO-8601 text.

The text is the core's, so that it costs nothing per row here.
"""

from __future__ import annotations

import _modlens
from analyzer import exports

__all__ = ["Format"]


class Format(exports.Format):
    """JSON lines of some columns of one table."""

    def rows(self, table: _modlens.Table) -> bytes:
        """The rows; nothing stands in front of them."""
        return table.jsonl(self.wish.columns)
