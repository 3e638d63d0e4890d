"""A bus and a day as one flat row: the verdict, the first diagnoses, rates and margins.

What somebody with hundreds of taps looks at: `modlens doctor ARCHIVE --to csv` writes these rows,
and a tap publishes that of its day. The core makes them, for the tap without Python as well.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import _modlens

__all__ = ["COLUMNS", "bus_day"]

COLUMNS: Mapping[str, str] = MappingProxyType(dict(_modlens.bus_day_columns()))
"""Key -> meaning, in order; what a recording does not tell is null. Shares are from 0 to 1."""


def bus_day(day: Mapping[str, Any]) -> dict[str, Any]:
    """The row of an item of `_modlens.Days.rows`."""
    row: dict[str, Any] = json.loads(_modlens.bus_day_row(json.dumps(day)))
    return row
