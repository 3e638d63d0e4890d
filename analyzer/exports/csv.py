"""CSV (RFC 4180): a line of column names, then a line a row.

Lists joined by single spaces, null empty.

The text is the core's, so that it costs nothing per row here.
"""

from __future__ import annotations

from collections.abc import Sequence

import _modlens

__all__ = ["Format"]


class Format:
    """CSV of some columns of one table."""

    def __init__(self, columns: Sequence[str]) -> None:
        self._columns = tuple(columns)
        self._begun = False

    def rows(self, table: _modlens.Table) -> bytes:
        """The rows, behind the line of names the first time."""
        header, self._begun = not self._begun, True
        return table.csv(self._columns, header=header)
