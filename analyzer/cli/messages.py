"""Messages for the user on standard error: detection, unread lines, the summary, errors."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING, Any

from analyzer.cli.progress import ProgressLine
from analyzer.cli.standard_streams import STDERR, discard_output
from analyzer.unread import unread
from analyzer.views.screen import Screen, visible
from analyzer.views.summary import summary
from dissectors.errors import SourceError

if TYPE_CHECKING:
    from analyzer.session import RecordingStatus

__all__ = ["Messages"]

_CLOCKS = {
    "none": "no timestamps",
    "relative": "timestamps from the start of the recording",
    "time of day": "timestamps without a date",
    "local": "local timestamps, zone unknown",
    "utc": "UTC timestamps",
}


_TIME_UNITS_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_COARSE_NS = 100_000_000


class Messages:
    """Prints messages to standard error; with `quiet` errors only.

    `unparsed_lines` counts the lines of text recordings that could not be parsed so far. `progress`
    is the line that says how far the reading has come, unless rows go to the same terminal.
    `timezone` is the zone that the user gave for timestamps that state none.
    """

    def __init__(
        self, *, quiet: bool, rows_on_terminal: bool = False, timezone: str | None = None
    ) -> None:
        self.progress = ProgressLine(shown=not rows_on_terminal)
        self._quiet = quiet
        self._timezone = timezone
        self._screen = Screen(sys.stderr)
        self.unparsed_lines = 0

    def recording_status(self, status: RecordingStatus) -> None:
        """Report a recording: at its beginning the format, at its end what was not read."""
        if status.unreadable:
            self.error(f"{status.name}: {status.reason}; skipped")
        elif not status.format:
            self.info(f"{status.name}: skipped: {status.reason}")
        elif status.ended:
            self._report_unread(status)
        else:
            self._report_detection(status)

    def info(self, text: str) -> None:
        """Print one line unless quiet; on a terminal it is wrapped."""
        if self._quiet:
            return
        import textwrap  # noqa: PLC0415 - `export` is quiet

        width = self._screen.width if self._screen.is_terminal else sys.maxsize
        for part in textwrap.wrap(text, width, subsequent_indent="  ", drop_whitespace=False):
            self._print(part.rstrip(), "dim")

    def error(self, text: str) -> None:
        """Print an error as one line, even when quiet."""
        self._print(f"modlens: {text}", "")

    def statistics(self, stats: dict[str, Any], doctor: dict[str, Any] | None = None) -> None:
        """Print the statistics table of `modlens stats`; see there for `doctor`."""
        if not self._quiet:
            from analyzer.views.stats import show_stats  # noqa: PLC0415 - most commands show none

            with contextlib.suppress(BrokenPipeError, SourceError):
                show_stats(stats, self._screen, doctor)

    def summary(self, stats: dict[str, Any]) -> None:
        """Print the summary of a run: frames by verdict, transactions by status, findings."""
        for line in summary(stats):
            self.info(line)

    def _print(self, text: str, style: str) -> None:
        """Print one line; a closed standard error is ignored so that the outputs are completed."""
        self.progress.wipe()
        try:
            self._screen.line(visible(text), style)
        except (BrokenPipeError, SourceError):
            discard_output(STDERR)

    def _report_detection(self, status: RecordingStatus) -> None:
        """Report the detected format, its confidence, the clock, the mode and further details."""
        details = status.details
        certainty = (
            "named by --from"
            if status.forced
            else f"{100 * status.confidence:.0f} % certain: {status.reason}"
        )
        words = [f"{status.name}: {status.format} ({certainty})"]
        clock = details.get("clock") or "none"
        times = _CLOCKS.get(clock, f"clock: {clock}")
        if clock == "utc" and self._timezone is not None:
            times = f"timestamps, read as {self._timezone} where they state no zone"
        words.append(times + _resolution(details, clock))
        if details.get("mode"):
            words.append(f"mode {details['mode']}")
        words += details.get("said", [])
        self.info(", ".join(words))

    def _report_unread(self, status: RecordingStatus) -> None:
        """Report what was not read: damage, skipped entries, lines that were not understood."""
        details = status.details
        if "trouble" in details:
            self.error(f"{status.name}: {details['trouble']}")
        self.unparsed_lines += details.get("unparsed", 0)
        for sentence in unread(status):
            self.info(sentence)


def _resolution(details: dict[str, Any], clock: str) -> str:
    """The resolution of a recording's clock in words, with a warning where it is coarse."""
    resolution = details.get("resolution_ns")
    if clock == "none" or not resolution:
        return ""
    name, length = next(pair for pair in _TIME_UNITS_NS.items() if resolution >= pair[1])
    coarse = "; too coarse for response times" if resolution >= _COARSE_NS else ""
    return f", resolution {resolution // length} {name}{coarse}"
