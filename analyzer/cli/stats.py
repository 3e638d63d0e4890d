"""`modlens stats`: who talks on the bus, how much, how well, how fast."""

from __future__ import annotations

import argparse
from dataclasses import replace

from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED, SIGNALLED
from analyzer.cli.parser import add_decoding, add_input, add_line, settings
from analyzer.cli.segmentation import report_silence_limits
from analyzer.cli.stop_signals import StopSignals
from analyzer.session import FileRun
from analyzer.views.health import show_verdict
from analyzer.views.screen import stdout
from analyzer.views.stats import show_stats
from analyzer.views.summary import damaged
from dissectors.errors import CaptureError

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    add_decoding(parser)
    add_line(parser)
    parser.add_argument(
        "--strict",
        action="store_true",
        help="exit with status 1 if any frame was damaged or a line could not be parsed",
    )


def run(options: argparse.Namespace) -> int:
    """Decode the recordings, then print the statistics; gives the exit status."""
    messages = Messages(quiet=False)
    chosen = replace(settings(options), tables=("diagnoses",))
    report_silence_limits(chosen, messages)
    files = FileRun(
        options.files, chosen, read_as=options.read_as, on_status=messages.recording_status
    )
    with StopSignals() as stop_signals:
        for _ in files.batches():
            if stop_signals.received():
                files.finish()
                break
        stats = files.stats()
        show_verdict(files.doctor(), stdout())
        stdout().line("")
        show_stats(stats, stdout())
        if stop_signals.signal is not None:
            return SIGNALLED + stop_signals.signal
    if files.unreadable:
        return CaptureError.exit_status
    return DAMAGED if options.strict and (damaged(stats) or messages.unparsed_lines) else 0
