"""The tool `diagnose`: what `modlens doctor` says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from analyzer.assistants.answers import Row, page, without_empty
from analyzer.assistants.fence import Fence
from analyzer.assistants.reading import Reading

__all__ = ["answer"]


def answer(fence: Fence, arguments: Mapping[str, Any]) -> str:
    """The verdict, then the diagnoses, the margins of the units and what was not judged."""
    reading = Reading(fence, arguments)
    for _ in reading.batches("diagnoses"):
        pass
    found = reading.doctor()
    rows: list[Row] = [
        (name, without_empty(row))
        for name in ("diagnoses", "reserves", "not_judged")
        for row in found[name]
    ]
    verdict = {key: found[key] for key in ("verdict", "sentence", "requests", "failed")}
    offset = arguments.get("offset", 0)
    return page(reading.head | verdict, rows[offset:], offset=offset, total=len(rows))
