"""`modlens baseline`: describe what is usual on the buses of recordings."""

from __future__ import annotations

import argparse

from analyzer.baseline_file import dumps
from analyzer.cli.import_ import write_text
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.selection import add_selection
from analyzer.cli.watched_files import watched

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens baseline monday.pcap tuesday.pcap -o usual.toml
  modlens security wednesday.pcap --baseline usual.toml

Use recordings of every phase: day, night, cleaning, an operator at work.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument(
        "-o", dest="output", metavar="OUT", help="TOML file to write (default: standard output)"
    )
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Decode the recordings and write the baseline; gives the exit status."""
    messages = Messages(quiet=options.output is None, timezone=options.timezone)
    watch, status = watched(options, (), messages)
    write_text(dumps(watch.usage()), options.output)
    return status
