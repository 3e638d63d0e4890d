"""The tool `registers`: what `modlens map` shows."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import _modlens
from analyzer.assistants.answers import Row, page, without_empty
from analyzer.assistants.fence import Fence
from analyzer.assistants.reading import Reading

__all__ = ["answer"]


def answer(fence: Fence, arguments: Mapping[str, Any]) -> str:
    """The registers and bits that were seen, of one unit or kind where the arguments say so."""
    reading = Reading(fence, arguments)
    registers = _modlens.RegisterMap()
    for batch in reading.batches("transactions"):
        registers.add(batch)
    rows = [row for row in json.loads(registers.rows()) if _is_wanted(row, arguments)]
    dull = ("bus",) if len({row["bus"] for row in rows}) == 1 else ()
    offset = arguments.get("offset", 0)
    listed: list[Row] = [("registers", without_empty(row, dull)) for row in rows[offset:]]
    return page(reading.head, listed, offset=offset, total=len(rows))


def _is_wanted(row: Mapping[str, Any], arguments: Mapping[str, Any]) -> bool:
    return (
        arguments.get("unit") in (None, row["unit"])
        and arguments.get("kind") in (None, row["register_type"])
        and (row["changes"] > 0 or not arguments.get("changed"))
    )
