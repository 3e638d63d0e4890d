"""`modlens match`: find the known profile that best matches a unit."""

from __future__ import annotations

import argparse

from analyzer.cli.known_devices import ranked, usable_profiles
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.register_survey import chosen_unit, survey, tables_of
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
    found = survey(options)
    tables = tables_of(found)
    units = sorted({table["unit"] for table in tables})
    if options.unit is not None:
        units = [chosen_unit(tables, options.unit, "match")]
    profiles = [load(name) for name in options.names] or list(usable_profiles())
    most = len(profiles) if options.names or options.all else MOST_SHOWN
    screen = stdout()
    for unit in units:
        screen.line(f"unit {unit}", "head")
        scored = ranked(found, unit, profiles)
        for score, profile in scored[:most]:
            style = "good" if score.fits else "dim"
            head = f"  {score.percent:3d} %  {profile.name}: "
            screen.lines([[(head, style), (visible("; ".join(score.reasons)), "")]])
        if not any(score.fits for score, _ in scored):
            none = f"  no profile fits, of {len(profiles)}; modlens learn makes a draft"
            screen.line(none, "dim")
    return 0
