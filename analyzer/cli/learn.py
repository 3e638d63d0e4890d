"""`modlens learn`: derive a skeleton of a device profile from recorded traffic."""

from __future__ import annotations

import argparse
from typing import Any

from analyzer.cli.import_ import show_notes, write_text
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.register_survey import survey
from analyzer.cli.selection import add_selection
from dissectors.errors import UsageError
from dissectors.importers.toml import dumps
from dissectors.profile import from_model
from dissectors.profile_learning import answer_lines, evidence_lines, profile_skeleton

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens learn bus.bin --unit 3 -o device.toml
  modlens learn bus.bin
  modlens learn bus.bin --to jsonl

The profile goes to standard output, the evidence to standard error. Registers
are combined into 32-bit or longer types only where the data support it, and
role, scale and quantity are given only where the data decide them.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument(
        "--unit", type=int, metavar="N", help="the unit to learn, if there are several"
    )
    parser.add_argument(
        "-o", dest="output", metavar="OUT", help="TOML file to write (default: standard output)"
    )
    add_selection(parser)
    parser.add_argument(
        "--to",
        choices=("toml", "jsonl"),
        default="toml",
        help="toml: a profile (default); jsonl: an object per value, each answer with its odds",
    )
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Learn; gives the exit status."""
    tables = survey(options)
    if options.to == "jsonl":
        chosen = [table for table in tables if options.unit in (None, table["unit"])]
        write_text(answer_lines(chosen), options.output)
        return 0
    unit_tables = tables_of_unit(tables, options.unit, "learn")
    model = profile_skeleton(unit_tables, options.files[0])
    from_model(model, options.files[0])
    write_text(dumps(model), options.output)
    show_notes(evidence_lines(unit_tables))
    return 0


def tables_of_unit(
    tables: list[dict[str, Any]], unit: int | None, command: str
) -> list[dict[str, Any]]:
    """The tables of one unit; `UsageError` where several units were seen and none is chosen."""
    units = sorted({table["unit"] for table in tables})
    if unit is None and len(units) == 1:
        unit = units[0]
    if unit not in units:
        there = f"there are {', '.join(map(str, units))}" if units else "no unit answered"
        raise UsageError(f"{command}: choose a unit with --unit N; {there}")
    return [table for table in tables if table["unit"] == unit]
