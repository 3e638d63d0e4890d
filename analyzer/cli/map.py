"""`modlens map`: the register map as last seen."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace

import _modlens
from analyzer.addresses import BASES
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.known_devices import device_hints, usable_profiles
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.selection import add_selection
from analyzer.cli.standard_streams import report
from analyzer.cli.stop_signals import StopSignals
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
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Go through the recordings, then print the map; gives the exit status."""
    messages = Messages(quiet=False, timezone=options.timezone)
    chosen = replace(settings(options), tables=("transactions",))
    files = file_run(options, chosen, messages)
    found = _modlens.RegisterMap()
    # What is named already needs no hint, and a program that reads JSON none either.
    survey = None if options.json or chosen.profiles else _modlens.Survey()
    with StopSignals() as stop_signals:
        for batch in files.batches():
            found.add(batch)
            if survey is not None:
                survey.add(batch)
            if stop_signals.received():
                found.add(files.finish())
                break
        rows = [
            row
            for row in json.loads(found.rows())
            if options.unit in (None, row["unit"]) and (row["name"] or not options.named)
        ]
        show_map(rows, stdout(), options.address, as_json=options.json)
        if survey is not None:
            tables = json.loads(survey.tables())
            for hint in device_hints(tables, list(usable_profiles())):
                report(hint)
        return 0 if stop_signals.signal is None else SIGNALLED + stop_signals.signal
