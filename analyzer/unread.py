"""Sentences about what of a recording was not read: damage, skipped entries, lines of a log."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from analyzer.counts import count_of
from analyzer.views.screen import fit, visible

if TYPE_CHECKING:
    from analyzer.session import RecordingStatus

__all__ = ["is_lost", "unread"]

EXCERPT_COLUMNS = 60
"""Terminal columns that are shown of a line that could not be parsed."""

_FEW = 10
"""Comments hold hex as well: fewer such lines than one in so many records are no traffic."""


def unread(status: RecordingStatus) -> Iterator[str]:
    """What was not read of a recording that has ended, or was skipped; lines begin with blanks."""
    details = status.details
    later = [name for name in details.get("formats", []) if name not in status.format.split("+")]
    if later:
        yield f"{status.name}: also has lines of {', '.join(later)}"
    for reason, count in (details.get("dropped") or {}).items():
        size = (details.get("dropped_bytes") or {}).get(reason)
        held = f" ({count_of(size, 'byte')})" if size else ""
        yield f"{status.name}: {count:,} skipped: {reason}{held}"
    unparsed = details.get("unparsed", 0)
    if unparsed:
        lines = count_of(details["lines"], "line")
        hexed = details["unparsed_with_hex"]
        amount = count_of(details["unparsed_hex_bytes"], "byte")
        held = f"; {hexed:,} of them hold{'s' * (hexed == 1)} {amount} of hex" if hexed else ""
        yield f"{status.name}: {unparsed:,} of {lines} could not be parsed{held}"
        for number, text, _ in details["unparsed_examples"]:
            yield f"  line {number}: {fit(visible(text), EXCERPT_COLUMNS).rstrip()}"


def is_lost(status: RecordingStatus) -> bool:
    """Whether that is likely to be traffic: many lines with bytes, or all packets of a capture."""
    details = status.details
    records = details.get("records", 0)
    is_empty = 0 < records <= max((details.get("dropped") or {"": 0}).values())
    return is_empty or bool(_FEW * details.get("unparsed_with_hex", 0) > records)
