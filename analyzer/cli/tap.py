"""`modlens tap`: what happens on a serial line, live. It listens only."""

from __future__ import annotations

import argparse
from contextlib import closing

from analyzer.cli.notes import Notes
from analyzer.cli.parser import add_decoding, add_line, add_rows
from analyzer.cli.running import DAMAGED, TABLE, Outputs, run_settings
from analyzer.cli.segmentation import announce
from analyzer.cli.stopping import Stopping
from analyzer.line import EXAMPLE
from analyzer.session import LiveRun
from analyzer.views.summary import damaged
from dissectors.errors import UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens tap /dev/ttyUSB0 --line 19200-8E1
  modlens tap /dev/ttyUSB0 --line 9600-8N1 -o today.csv --where "status != 'ok'"
  modlens tap socket://192.168.1.50:4001 --line 19200-8E1 --to jsonl

A B are two buses; A+B is one bus of which each direction has its own port.
-o adds a file that grows while the tap runs; it must not exist yet.
Ctrl-C ends.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("ports", nargs="+", metavar="PORT", help="a device or a URL, see below")
    add_line(parser)
    add_rows(parser)
    add_decoding(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Listen until a signal comes; gives the exit status."""
    settings = run_settings(options)
    if settings.line is None:
        raise UsageError(
            "tap: the line settings are needed: add --line and baud, data bits, parity and stop"
            f" bits in one word, as --line {EXAMPLE}"
        )
    notes = Notes(quiet=False)
    announce(settings, notes)
    with Stopping() as stopping, closing(LiveRun(options.ports, settings)) as live:
        with Outputs(options, notes, to=options.to or TABLE, growing=True) as outputs:
            ports = ", ".join(options.ports)
            notes.say(f"listening to {ports} at {settings.line}; nothing is sent; Ctrl-C ends")
            try:
                outputs.pump(live, stopping)
            finally:
                outputs.close()
                stats = live.stats()
                if not outputs.silenced:
                    notes.summary(stats)
    if options.strict and damaged(stats) and not outputs.status:
        return DAMAGED
    return outputs.status
