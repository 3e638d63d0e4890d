"""Arrow files (IPC with a footer, also called Feather 2), uncompressed: they can be mapped."""

from __future__ import annotations

from analyzer.exports import parquet

__all__ = ["Format"]


class Format(parquet.Format):
    """An Arrow file of some columns of one table."""

    name = "arrow"
    styles = ()
