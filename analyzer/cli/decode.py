"""`modlens decode`: recordings as a table on the screen, or as files."""

from __future__ import annotations

import argparse

from analyzer.cli.parser import add_decoding, add_input, add_line, add_rows
from analyzer.cli.running import TABLE, run_files

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens decode bus.hex
  modlens decode bus.bin --mode rtu --where "status != 'ok'"
  modlens decode bus.jsonl --line 19200-8E1 -o bus.csv -o frames:frames.jsonl
  modlens decode - --from hex --to jsonl < bus.txt

Without -o and --to the table goes to the screen; --to table brings it back
beside -o.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument(
        "--follow",
        action="store_true",
        help="go on reading where the last file grows, until Ctrl-C",
    )
    add_rows(parser)
    add_decoding(parser)
    add_line(parser)
    parser.add_argument(
        "--replay",
        action="store_true",
        help="decode as a live tap would, without looking ahead: gives its rows",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Decode; gives the exit status."""
    to = options.to or (None if options.outputs else TABLE)
    return run_files(options, to=to, quiet=False, follow=options.follow)
