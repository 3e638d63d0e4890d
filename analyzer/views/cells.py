"""Texts of cells in small tables: buses, functions, times in milliseconds.

The cells of the tables of rows are made in the core (view/cell_texts.rs).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from analyzer.explanations import TITLES
from analyzer.views.grid import ColumnLayout, GridColumn
from analyzer.views.screen import visible, width_of
from dissectors.table import function as table_function

__all__ = [
    "BASE_TITLES",
    "MEASURED",
    "OTHER",
    "bus_field",
    "function_name",
    "labels",
    "milliseconds",
    "number",
    "share_of",
]

MEASURED = f"measured: {TITLES['measured']}"
OTHER = "late answers, broadcasts, and requests whose outcome was not recorded"
"""What two columns mean, for the line below their table."""

BASE_TITLES = {
    "wire": "addr from 0",
    "hex": "hex from 0",
    "5digit": "40001-based",
    "6digit": "400001-based",
}
"""Address notation -> title of an address column."""

MAX_LABEL_COLUMNS = 16
"""Terminal columns of a bus's short name."""

_WHOLE_MS_FROM_US = 100_000
"""From this time on, in microseconds, milliseconds are shown without decimals."""


def labels(names: Sequence[str]) -> dict[str, str]:
    """Short names for buses: as much of the end of each path as is needed to tell them apart.

    >>> labels(["a/bus.hex", "a/other.hex"])
    {'a/bus.hex': 'bus.hex', 'a/other.hex': 'other.hex'}
    >>> list(labels(["logs/monday/bus.hex", "logs/tuesday/bus.hex"]).values())
    ['monday', 'tuesday']
    """
    parts = {name: visible(name).replace("\\", "/").rstrip("/").split("/") for name in names}
    while len(parts) > 1 and len({tuple(part[-1:]) for part in parts.values()}) == 1:
        if min(map(len, parts.values())) == 1:
            break
        parts = {name: part[:-1] for name, part in parts.items()}
    found: dict[str, str] = {}
    longest = max(map(len, parts.values()), default=0)
    for depth in range(1, longest + 1):
        found = {name: "/".join(part[-depth:]) for name, part in parts.items()}
        if len(set(found.values())) == len(found):
            break
    return {
        name: "…" + label[1 - MAX_LABEL_COLUMNS :] if len(label) > MAX_LABEL_COLUMNS else label
        for name, label in found.items()
    }


def bus_field(names: Sequence[str], name_of: Callable[[Any], str]) -> GridColumn:
    """The grid column with the bus of a row; `name_of` gives its full name."""
    short = labels(names)
    width = max(map(width_of, short.values()), default=0)
    return GridColumn(
        ColumnLayout("bus", min(width, MAX_LABEL_COLUMNS)),
        lambda row: short.get(name_of(row), name_of(row)),
    )


def number(value: int | None) -> str:
    """A number as text; empty for None."""
    return "" if value is None else str(value)


def milliseconds(microseconds: float | None) -> str:
    """Microseconds as milliseconds.

    >>> milliseconds(1234.5), milliseconds(250_000.0), milliseconds(None)
    ('1.2', '250', '')
    """
    if microseconds is None:
        return ""
    digits = 1 if microseconds < _WHOLE_MS_FROM_US else 0
    return f"{microseconds / 1e3:.{digits}f}"


def share_of(part: int, whole: int) -> str:
    """Which part of them, in words; only the number where it is all of them.

    >>> share_of(3, 12), share_of(12, 12)
    ('3 of 12', '12')
    """
    return f"{part:,}" if part == whole else f"{part:,} of {whole:,}"


def function_name(row: Mapping[str, Any]) -> str:
    """Code and name of the function in a row of the statistics.

    >>> function_name({"function": 3})
    ' 3 Read Holding Registers'
    """
    code = row["function"]
    try:
        name = table_function(code).name
    except KeyError:
        name = "unknown"
    return f"{code:2d} {name}"
