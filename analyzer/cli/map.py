"""`modlens map`: the register map as last seen."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace

import _modlens
from analyzer.addresses import BASES
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_decoding, add_input, add_line, settings
from analyzer.cli.stop_signals import StopSignals
from analyzer.session import FileRun
from analyzer.views.registers import show_map
from analyzer.views.screen import stdout

__all__ = ["add_arguments", "run"]

SIGNALLED = 128

EPILOG = """\
examples:
  modlens map bus.hex --profile 1=mightyzap
  modlens map bus.bin --unit 3 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument("--unit", type=int, metavar="N", help="only this unit")
    parser.add_argument("--named", action="store_true", help="only registers named in a profile")
    parser.add_argument(
        "--address", choices=BASES, default="wire", help="how to show addresses (default: wire)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object per line")
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Go through the recordings, then print the map; gives the exit status."""
    messages = Messages(quiet=False)
    chosen = replace(settings(options), tables=("transactions",))
    files = FileRun(
        options.files, chosen, read_as=options.read_as, on_status=messages.recording_status
    )
    found = _modlens.RegisterMap()
    with StopSignals() as stop_signals:
        for batch in files.batches():
            found.add(batch)
            if stop_signals.received():
                found.add(files.finish())
                break
        rows = [
            row
            for row in json.loads(found.rows())
            if options.unit in (None, row["unit"]) and (row["name"] or not options.named)
        ]
        show_map(rows, stdout(), options.address, as_json=options.json)
        return 0 if stop_signals.signal is None else SIGNALLED + stop_signals.signal
