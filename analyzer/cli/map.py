"""`modlens map`: the register map as last seen."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import _modlens
from analyzer.addresses import BASES
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.known_devices import device_hints, usable_profiles
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.register_survey import chunks, tables_of
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
        rows = MapRows(found, options.unit, named=options.named)
        show_map(rows, stdout(), options.address, as_json=options.json)
        if survey is not None:
            for hint in device_hints(survey, tables_of(survey), list(usable_profiles())):
                report(hint)
        return 0 if stop_signals.signal is None else SIGNALLED + stop_signals.signal


class MapRows:
    """The rows of a map, of which some are objects of Python at a time."""

    def __init__(self, found: _modlens.RegisterMap, unit: int | None, *, named: bool) -> None:
        self._found = found
        self._unit = unit
        self._named = named

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All rows of the chosen unit; only those with a name where they are wanted."""
        for chunk in chunks(self._found.rows):
            for row in chunk:
                if self._unit in (None, row["unit"]) and (row["name"] or not self._named):
                    yield row
