"""`modlens stats`: who talks on the bus, how much, how well, how fast."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any, Literal

from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED, SIGNALLED
from analyzer.cli.parser import add_decoding, add_input, add_line, add_strict
from analyzer.cli.recording_document import RecordingDocument
from analyzer.cli.selection import add_selection
from analyzer.cli.standard_streams import print_text
from analyzer.cli.stop_signals import StopSignals
from analyzer.views.courses import show_courses
from analyzer.views.health import show_verdict
from analyzer.views.screen import stdout
from analyzer.views.stats import show_stats
from analyzer.views.summary import damaged
from dissectors.errors import CaptureError

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.add_argument(
        "--to",
        choices=("json",),
        help="write one JSON document instead of text: statistics, and what the doctor says",
    )
    add_strict(parser)


def run(options: argparse.Namespace) -> int:
    """Decode the recordings, then print the statistics; gives the exit status."""
    messages = Messages(quiet=options.to is not None, timezone=options.timezone)
    with StopSignals() as stop_signals:
        drawn: Literal["series", "all"] = "series" if options.to is None else "all"
        recording = RecordingDocument(options, messages, stop_signals, overview=drawn)
        counted = recording.counted
        stats, found = counted["statistics"], counted["doctor"]
        if options.to is None:
            show_verdict(found, stdout())
            stdout().line("")
            show_stats(stats, stdout(), found)
            show_courses(counted["overview"], stdout())
        else:
            print_text(_json(recording.document))
        if stop_signals.signal is not None:
            return SIGNALLED + stop_signals.signal
    if recording.unreadable:
        return CaptureError.exit_status
    return DAMAGED if options.strict and (damaged(stats) or messages.unparsed_lines) else 0


def _json(document: Mapping[str, Any]) -> str:
    """The document as indented JSON; lists of numbers, which are long, on a line each."""
    import json  # noqa: PLC0415
    import re  # noqa: PLC0415

    text = json.dumps(document, indent=2, ensure_ascii=False)
    column = r"\[\s+((?:[-+.\w]+,\s+)*[-+.\w]+)\s+\]"
    return re.sub(column, lambda found: f"[{' '.join(found[1].split())}]", text) + "\n"
