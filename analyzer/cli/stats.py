"""`modlens stats`: who talks on the bus, how much, how well, how fast."""

from __future__ import annotations

import argparse
from dataclasses import replace

from analyzer.cli.messages import Notes
from analyzer.cli.outputs import DAMAGED, SIGNALLED
from analyzer.cli.parser import add_decoding, add_input, add_line, settings
from analyzer.cli.segmentation import announce
from analyzer.cli.stop_signals import Stopping
from analyzer.session import FileRun
from analyzer.views.screen import stdout
from analyzer.views.stats import show_stats
from analyzer.views.summary import damaged

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    add_decoding(parser)
    add_line(parser)
    parser.add_argument(
        "--strict", action="store_true", help="exit status 1 if anything was damaged"
    )


def run(options: argparse.Namespace) -> int:
    """Count everything, then print it; gives the exit status."""
    notes = Notes(quiet=False)
    chosen = replace(settings(options), tables=())
    announce(chosen, notes)
    files = FileRun(options.files, chosen, read_as=options.read_as, told=notes.intake)
    with Stopping() as stopping:
        for _ in files.batches():
            if stopping.asked():
                files.finish()
                break
        stats = files.stats()
        show_stats(stats, stdout())
        if stopping.signal is not None:
            return SIGNALLED + stopping.signal
    return DAMAGED if options.strict and (damaged(stats) or notes.unparsed) else 0
