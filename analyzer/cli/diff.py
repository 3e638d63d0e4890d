"""`modlens diff`: what differs between two recordings, such as those of two days."""

from __future__ import annotations

import argparse

from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.selection import add_selection
from analyzer.cli.standard_streams import print_text
from analyzer.cli.watched_files import watched
from analyzer.security import rules
from analyzer.views.screen import stdout
from analyzer.views.security import FORMATS, render, show_findings
from dissectors.errors import UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens diff monday.pcap tuesday.pcap
  modlens diff before.jsonl after.jsonl --line 19200-8E1 --to md

The first recording is the one from before. For several files on one side, make
a baseline of them: modlens baseline FILE... -o usual.toml, then
modlens security FILE... --baseline usual.toml.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument("--to", choices=FORMATS, help="write to standard output, instead of text")
    parser.add_argument(
        "--strict", action="store_true", help="exit with status 1 if there is a difference"
    )
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Compare two recordings; gives the exit status."""
    if len(options.files) != 2:  # noqa: PLR2004 - before and after
        raise UsageError(f"diff: give two recordings, not {len(options.files)}")
    messages = Messages(quiet=options.to is not None, timezone=options.timezone)
    before, status = watched(options, rules(), messages, options.files[:1])
    after, other_status = watched(options, rules(), messages, options.files[1:])
    found = after.deviations(before.usage(), values=True)
    rows = [one.row() for one in found]
    if options.to is not None:
        print_text(render(rows, options.to))
    else:
        screen = stdout()
        if not rows:
            screen.line("No difference.", "ok")
        show_findings(rows, screen)
    return max(status, other_status) or (DAMAGED if options.strict and rows else 0)
