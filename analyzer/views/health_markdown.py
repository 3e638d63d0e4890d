"""What the doctor says as Markdown, to be pasted into a ticket.

>>> doctor = {"sentence": "This line is healthy.", "diagnoses": [], "reserves": []}
>>> doctor["not_judged"] = doctor["unexplained"] = []
>>> print("".join(markdown(doctor)).rstrip())
**This line is healthy.**
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from analyzer.views import cells
from analyzer.views.health import level, unexplained
from analyzer.views.screen import visible

__all__ = ["markdown"]

_HEAD = (
    *("bus", "unit", "requests", "answered", "timed", "p99 ms", "timeout ms", "late", "damaged"),
    "clock",
)
_CLOCKS = {"utc": "UTC", "relative": "since the start", "none": "none"}
_WHAT_IS_TIMED = (
    "Timed answers: from the end of the request to the start of the response, by the clock of the"
    " recording."
)


def markdown(doctor: Mapping[str, Any]) -> Iterator[str]:
    """The document in blocks."""
    yield f"**{_escaped(doctor['sentence'])}**\n"
    for number, row in enumerate(doctor["diagnoses"], 1):
        yield f"\n{number}. `{row['code']}` ({level(row)}): {_escaped(row['sentence'])}\n"
        if row["examples"]:
            yield f"   - Transactions: {', '.join(map(str, row['examples']))}\n"
        if row["evidence"]:
            yield f"   - {_escaped(row['evidence'])}\n"
        yield f"   - Check: {_escaped(row['advice'])}\n"
        yield f"   - Proof: {_escaped(row['proof'])}\n"
    for text in unexplained(doctor):
        yield f"\n{_escaped(text)}\n"
    if doctor["reserves"]:
        yield f"\n{_WHAT_IS_TIMED}\n\n"
        yield f"| {' | '.join(_HEAD)} |\n"
        yield f"| --- |{' ---: |' * (len(_HEAD) - 1)}\n"
    for row in doctor["reserves"]:
        times = [cells.milliseconds(row[key]) for key in ("response_time_p99_us", "timeout_us")]
        counts = [row[key] for key in ("unit", "requests", "answered", "timed")]
        rest = [row["late"], row["damaged"], _CLOCKS[row["clock"]]]
        all_cells = [_escaped(row["bus"]), *counts, *times, *rest]
        yield f"| {' | '.join(map(str, all_cells))} |\n"
    if doctor["not_judged"]:
        yield "\nNot judged:\n\n"
    for row in doctor["not_judged"]:
        yield f"- {_escaped(row['bus'])}: {_escaped(row['what'])}. This needs {row['needs']}.\n"
    # What is appended to the document, such as a table of --to md, begins a paragraph of its own.
    yield "\n"


def _escaped(text: str) -> str:
    """The text without anything that Markdown would take for markup."""
    return re.sub(r"([\\`*_\[\]<>|])", r"\\\1", visible(text))
