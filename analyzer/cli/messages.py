"""What is said on standard error beside the rows.

What was detected, what could not be read, the summary.
"""

from __future__ import annotations

import contextlib
import sys
import textwrap
from typing import Any

from analyzer.cli.standard_streams import STDERR, discard_output
from analyzer.session import Intake
from analyzer.views.screen import Screen, fit, visible
from analyzer.views.stats import show_stats
from analyzer.views.summary import summary
from dissectors.errors import SourceError

__all__ = ["Notes"]

EXCERPT = 60
"""Columns of a line that was not understood."""

_CLOCKS = {
    "none": "no clock",
    "relative": "clock from the start of the recording",
    "time of day": "clock without a date",
    "local": "local clock, zone unknown",
    "utc": "UTC clock",
}


_UNITS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_COARSE = 100_000_000


class Notes:
    """Lines for the person at the terminal; none but errors when `quiet`."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._screen = Screen(sys.stderr)
        self.unparsed = 0

    def intake(self, intake: Intake) -> None:
        """A recording: at its beginning what it is, at its end what could not be read."""
        if not intake.format:
            self.say(f"{intake.name}: passed over: {intake.reason}")
        elif intake.ended:
            self._left_out(intake)
        else:
            self._detected(intake)

    def say(self, text: str) -> None:
        """One line, unless quiet; wrapped on a terminal."""
        if self._quiet:
            return
        width = self._screen.width if self._screen.is_terminal else sys.maxsize
        for part in textwrap.wrap(text, width, subsequent_indent="  ", drop_whitespace=False):
            self._print(part.rstrip(), "dim")

    def trouble(self, text: str) -> None:
        """One line of an error, always."""
        self._print(f"modlens: {text}", "")

    def statistics(self, stats: dict[str, Any]) -> None:
        """What `modlens stats` says of the same."""
        if not self._quiet:
            with contextlib.suppress(BrokenPipeError, SourceError):
                show_stats(stats, self._screen)

    def summary(self, stats: dict[str, Any]) -> None:
        """The last lines of a run."""
        for line in summary(stats):
            self.say(line)

    def _print(self, text: str, style: str) -> None:
        """Print one line; a terminal that is gone must not harm the outputs."""
        try:
            self._screen.line(visible(text), style)
        except (BrokenPipeError, SourceError):
            discard_output(STDERR)

    def _detected(self, intake: Intake) -> None:
        seen = intake.seen
        sure = (
            "ordered"
            if intake.ordered
            else f"{100 * intake.confidence:.0f} % sure: {intake.reason}"
        )
        words = [f"{intake.name}: {intake.format} ({sure})"]
        clock = seen.get("clock") or "none"
        words.append(_CLOCKS.get(clock, f"clock: {clock}") + _resolution(seen, clock))
        if seen.get("mode"):
            words.append(f"mode {seen['mode']}")
        words += seen.get("said", [])
        self.say(", ".join(words))

    def _left_out(self, intake: Intake) -> None:
        seen = intake.seen
        if "trouble" in seen:
            self.say(f"{intake.name}: {seen['trouble']}")
        later = [name for name in seen.get("formats", []) if name not in intake.format.split("+")]
        if later:
            self.say(f"{intake.name}: lines of {', '.join(later)}, too")
        unparsed = seen.get("unparsed", 0)
        self.unparsed += unparsed
        for reason, count in (seen.get("dropped") or {}).items():
            self.say(f"{intake.name}: {count:,} left out: {reason}")
        if unparsed:
            self.say(f"{intake.name}: {unparsed:,} of {seen['lines']:,} lines not understood")
            for number, text in seen["first_unparsed"]:
                self.say(f"  line {number}: {fit(visible(text), EXCERPT).rstrip()}")


def _resolution(seen: dict[str, Any], clock: str) -> str:
    """What the clock can tell apart, and what that means where it is coarse."""
    resolution = seen.get("resolution_ns")
    if clock == "none" or not resolution:
        return ""
    name, length = next(pair for pair in _UNITS.items() if resolution >= pair[1])
    coarse = "; too coarse for response times" if resolution >= _COARSE else ""
    return f" in steps of {resolution // length} {name}{coarse}"
