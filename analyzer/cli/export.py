"""`modlens export`: convert recordings to files; prints nothing unless something is wrong."""

from __future__ import annotations

import argparse

from analyzer.cli.outputs import run_files
from analyzer.cli.parser import add_decoding, add_input, add_line, add_rows

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens export bus.bin -o bus.csv
  modlens export *.hex -o all.jsonl -o findings:findings.csv --strict
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    add_rows(parser)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Export; gives the exit status."""
    return run_files(options, to=options.to, quiet=True)
