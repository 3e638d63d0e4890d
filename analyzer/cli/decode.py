"""`modlens decode`: recordings as a table on the screen, or as files."""

from __future__ import annotations

import argparse
from itertools import islice

from analyzer.cli.chosen_settings import settings
from analyzer.cli.live_watch import add_watch
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import TABLE, run_files
from analyzer.cli.parser import add_decoding, add_input, add_line, add_rows
from analyzer.sources import BINARY
from analyzer.sources.files import Recording
from analyzer.sources.pipes import STDIN
from analyzer.sources.settings_inference import infer_settings, reads, recorded_settings
from dissectors.errors import UsageError

__all__ = ["add_arguments", "run"]

SAMPLE_BLOCKS = 4
"""Blocks at the beginning of a recording that `--detect` looks at: 1 MiB together."""

EPILOG = """\
examples:
  modlens decode bus.hex
  modlens decode bus.bin --mode rtu --where "status != 'ok'"
  modlens decode bus.jsonl --line 19200-8E1 -o bus.csv -o frames:frames.jsonl
  modlens decode plant.pcapng --port 502,1502
  modlens decode - --from hex --to jsonl < bus.txt

The table is printed unless -o or --to is given; add --to table to print it
along with -o. A device profile (--profile) gives registers names and units.
Under "resp. ms", >322 means: not answered within this time.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument(
        "--follow",
        action="store_true",
        help="keep reading as the last file grows, until Ctrl-C",
    )
    add_rows(parser)
    add_decoding(parser)
    add_line(parser)
    add_watch(parser)
    parser.add_argument(
        "--replay",
        action="store_true",
        help="decode as a tap would have done, without looking at later bytes",
    )
    parser.add_argument(
        "--detect",
        action="store_true",
        help="also report which line settings the recorded bytes and line errors suggest; nothing"
        " is decoded differently",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Decode; gives the exit status."""
    if options.detect:
        _say_settings(options)
    to = options.to or (None if options.outputs else TABLE)
    return run_files(options, to=to, quiet=False, follow=options.follow)


def _say_settings(options: argparse.Namespace) -> None:
    """Report the line settings that each recording's bytes and marks of line errors suggest.

    Only raw recordings (`tap --record`) can tell all: raw bytes have neither times nor line errors,
    logs in text have lost them, and those of logic analyzers are reported as they are read.
    """
    messages, given = Messages(quiet=False), settings(options).line
    for name in options.files:
        if name == STDIN:
            raise UsageError("--detect reads the file twice; name a file instead of -")
        with Recording(name, read_as=options.read_as) as recording:
            data = b"".join(islice(recording.blocks(), SAMPLE_BLOCKS))
            kind = recording.detection.format
        if kind == "raw" or data.startswith(b"\x0a\x0d\x0d\x0a"):
            for line in infer_settings(list(reads(data)), given or recorded_settings(data)):
                messages.info(f"{name}: {line}")
        elif kind in BINARY and BINARY[kind].samples:
            messages.info(f"{name}: the settings of {kind} are in the note of its channels")
        else:
            messages.info(
                f"{name}: {kind} carries no line errors; --detect needs raw bytes or a"
                f" recording of --record"
            )
