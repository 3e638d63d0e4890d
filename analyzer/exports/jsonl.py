"""JSON lines: one object a row, null omitted, hex in lower case, times as ISO-8601 text.

The text is the core's, so that it costs nothing per row here.
"""

from __future__ import annotations

from collections.abc import Sequence

import _modlens

__all__ = ["Format"]


class Format:
    """JSON lines of some columns of one table."""

    def __init__(self, columns: Sequence[str]) -> None:
        self._columns = tuple(columns)

    def rows(self, table: _modlens.Table) -> bytes:
        """The rows; nothing stands in front of them."""
        return table.jsonl(self._columns)
