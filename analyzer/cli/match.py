"""`modlens match`: find the known profile that best matches a unit."""

from __future__ import annotations

import argparse

from analyzer.cli.known_devices import ranked, usable_profiles
from analyzer.cli.learn import tables_of_unit
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.register_survey import survey
from analyzer.cli.selection import add_selection
from analyzer.profiles import load
from analyzer.views.screen import stdout, visible

__all__ = ["add_arguments", "run"]

MOST_SHOWN = 5
"""Profiles that are shown for a unit."""

EPILOG = """\
examples:
  modlens match bus.hex
  modlens match bus.bin --unit 3 --with meter.toml --with pump.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument("--unit", type=int, metavar="N", help="only this unit (default: all)")
    parser.add_argument(
        "--with",
        dest="names",
        action="append",
        default=[],
        metavar="NAME|FILE",
        help="compare with this profile instead of all known ones; repeatable",
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help=f"show all known profiles (default: the {MOST_SHOWN} best)",
    )
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Score every profile for every unit; gives the exit status."""
    tables = survey(options)
    if options.unit is not None:
        tables = tables_of_unit(tables, options.unit, "match")
    profiles = [load(name) for name in options.names] or list(usable_profiles())
    most = len(profiles) if options.names or options.all else MOST_SHOWN
    screen = stdout()
    for unit in sorted({table["unit"] for table in tables}):
        screen.line(f"unit {unit}", "head")
        unit_tables = [table for table in tables if table["unit"] == unit]
        scored = ranked(unit_tables, profiles)
        for found, profile in scored[:most]:
            style = "good" if found.fits else "dim"
            head = f"  {found.points:3d} %  {profile.name}: "
            screen.lines([[(head, style), (visible("; ".join(found.reasons)), "")]])
        if not any(found.fits for found, _ in scored):
            screen.line(f"  none of {len(profiles)} fits; modlens learn makes a draft", "dim")
    return 0
