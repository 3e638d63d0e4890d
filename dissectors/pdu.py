"""The table of functions that the core has, and the direction that the layout of a PDU suggests."""

from __future__ import annotations

from typing import Literal, cast

import _modlens

__all__ = ["default_functions", "guess_direction"]

_SHARED: list[_modlens.Functions] = []


def default_functions() -> _modlens.Functions:
    """The embedded table, compiled once; no rows are ever added to it."""
    if not _SHARED:
        _SHARED.append(_modlens.Functions())
    return _SHARED[0]


def guess_direction(
    pdu: bytes, *, functions: _modlens.Functions | None = None
) -> Literal["request", "response", "unknown"]:
    """The direction whose layout fits, or "unknown" where both or none fit.

    Only the frames around it can tell for certain: an echo (functions 5, 6 ...) has the same layout
    in both directions.

    >>> guess_direction(bytes.fromhex("03 006B 0003")), guess_direction(bytes.fromhex("83 02"))
    ('request', 'response')
    >>> guess_direction(bytes.fromhex("06 0001 0003"))
    'unknown'
    """
    table = functions or default_functions()
    return cast("Literal['request', 'response', 'unknown']", table.guess_direction(pdu))
