"""JSON lines: one object per row, null omitted, hex in lower case, times as ISO-8601 text.

The text is made in the core.
"""

from __future__ import annotations

from analyzer.exports import csv

__all__ = ["Format"]


class Format(csv.Format):
    """JSON lines of some columns of one table, without a header."""

    name = "jsonl"
    styles = ()
