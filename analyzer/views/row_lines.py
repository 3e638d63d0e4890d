"""Options of the tables of rows: address notation, times, buses; the core makes the lines.

Layout and cells are in the core's `view` module: one renderer for the terminal, for files and for
the live screen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import _modlens
from analyzer.views.cells import labels

__all__ = ["TableOptions", "lines"]

_NS_PER_S = 1_000_000_000
_TIME_KINDS = {"local": "clock", "utc": "clock", "elapsed": "elapsed", "delta": "delta"}


@dataclass(frozen=True, slots=True)
class TableOptions:
    """How a table of rows is shown.

    `address` is one of `addresses.BASES`, `times` a value of `--times`; `buses` are the names of
    the buses: where there are several, each row shows its own.
    """

    address: str = "wire"
    times: str = "local"
    buses: tuple[str, ...] = ()


def lines(rows: Sequence[_modlens.Row], table_options: TableOptions, width: int) -> _modlens.Lines:
    """The renderer of a table that begins with these rows (at least one), `width` columns wide."""
    # The buses of a network capture are its servers, not the file.
    servers = dict.fromkeys(str(row.bus) for row in rows if getattr(row, "server", None))
    names = tuple(servers) or table_options.buses
    short = labels(names) if servers or len(names) > 1 else None
    return _modlens.Lines(
        rows,
        width,
        address=table_options.address,
        times=_TIME_KINDS[table_options.times],
        labels=None if short is None else list(short.items()),
        shift=_local_offset_ns if table_options.times == "local" else None,
    )


def _local_offset_ns(moment_ns: int) -> int:
    """The offset of local time from UTC at a moment, both in ns."""
    there = datetime.fromtimestamp(moment_ns // _NS_PER_S, UTC).astimezone()
    return (there.utcoffset() or timedelta()) // timedelta(microseconds=1) * 1000
