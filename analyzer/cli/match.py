"""`modlens match`: find the known profile that best matches a unit."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from analyzer.cli.learn import tables_of_unit
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.register_survey import survey
from analyzer.cli.standard_streams import report
from analyzer.profiles import available_profiles, load
from analyzer.views.screen import stdout, visible
from dissectors.errors import ModlensError
from dissectors.profile import Profile
from dissectors.profile_learning import score_profile

__all__ = ["add_arguments", "run"]

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
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Score every profile for every unit; gives the exit status."""
    tables = survey(options)
    if options.unit is not None:
        tables = tables_of_unit(tables, options.unit, "match")
    profiles = [load(name) for name in options.names] if options.names else list(_usable())
    screen = stdout()
    for unit in sorted({table["unit"] for table in tables}):
        screen.line(f"unit {unit}", "head")
        unit_tables = [table for table in tables if table["unit"] == unit]
        scored = [(score_profile(unit_tables, profile), profile) for profile in profiles]
        for found, profile in sorted(scored, key=lambda pair: (-pair[0].points, pair[1].name)):
            style = "good" if found.fits else "dim"
            head = f"  {found.points:3d} %  {profile.name}: "
            screen.lines([[(head, style), (visible("; ".join(found.reasons)), "")]])
    return 0


def _usable() -> Iterator[Profile]:
    """All available profiles that can be loaded; those with mistakes are reported and skipped."""
    for one in available_profiles():
        try:
            yield load(one.name)
        except ModlensError as error:
            what = f"{one.name} is skipped: {error.message.splitlines()[0]}"
            report(what)
