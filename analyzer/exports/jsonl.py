"""JSON lines: one object a row, null omitted, hex in lower case, times as ISO-8601 text.

The text is the core's, so that it costs nothing per row here.
"""

from __future__ import annotations

from analyzer.exports import csv

__all__ = ["Format"]


class Format(csv.Format):
    """JSON lines of some columns of one table; nothing stands in front of them."""

    name = "jsonl"
