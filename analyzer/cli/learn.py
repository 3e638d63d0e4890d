"""`modlens learn`: derive a skeleton of a device profile from recorded traffic."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import _modlens
from analyzer.cli.find import Search, add_known_value, check_times
from analyzer.cli.import_ import show_notes, write_text
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.register_survey import Table, chosen_unit, points, survey, tables_of
from analyzer.cli.selection import add_selection
from analyzer.views.learned import show_learned
from analyzer.views.screen import stdout
from dissectors.errors import UsageError
from dissectors.importers.toml import dumps, point_tables
from dissectors.profile import from_model
from dissectors.profile_learning import answer_line, evidence_lines, point_of, reason_lines

__all__ = ["add_arguments", "run"]

REGISTERS = ("ir", "hr")

LEAST_ODDS = 3.0
"""The odds in bits from which on a register is taken to hold a value."""

ALL_ROWS = 512
"""The samples that are kept of a block unless memory is short."""

EPILOG = """\
examples:
  modlens learn bus.bin --unit 3 -o device.toml
  modlens learn bus.bin
  modlens learn bus.bin --to table
  modlens learn bus.bin --to jsonl
  modlens learn day.pcapng --value 231.4 --at 12:03:10

The profile goes to standard output, the evidence to standard error. Registers
are combined into 32-bit or longer types only where the data support it, and
role, scale and quantity are given only where the data decide them. A value that
a display showed settles the scale of its register and of what belongs to it.
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
        choices=("toml", "table", "jsonl"),
        default="toml",
        help="toml: a profile (default); table: a line per value, what is open first;"
        " jsonl: an object per value, each answer with its odds",
    )
    add_known_value(parser)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Learn; gives the exit status."""
    check_times(options)
    search = Search(options) if options.values or options.like else None
    found = survey(options, search)
    if search is not None:
        show_notes([_anchored(found, search.found()[1]["candidates"])])
    tables = tables_of(found)
    if options.to == "jsonl":
        chosen = [table for table in tables if options.unit in (None, table["unit"])]
        write_text("".join(_answers(found, chosen)), options.output)
        return 0
    if options.to == "table":
        _show(found, tables, options)
        return 0
    unit = chosen_unit(tables, options.unit, "learn")
    chosen = [table for table in tables if table["unit"] == unit]
    write_text("".join(_profile(found, chosen, options.files[0])), options.output)
    show_notes(_evidence(found, chosen))
    return 0


def _show(found: _modlens.Survey, tables: list[Table], options: argparse.Namespace) -> None:
    """Print the tables of registers; of bits there is nothing to learn."""
    if options.output is not None:
        raise UsageError("learn: --to table writes to standard output, not to a file")
    for table in tables:
        if table["space"] in REGISTERS and options.unit in (None, table["unit"]):
            rows = [one for chunk in points(found, table) for one in chunk]
            show_learned(table, rows, options.files[0], stdout())


def _anchored(found: _modlens.Survey, candidates: Sequence[Mapping[str, Any]]) -> str:
    """Take the scale of the register that holds the value; gives a note about it."""
    if not candidates:
        return "no register holds the value; modlens find says what was tried"
    best = candidates[0]
    place = f"unit {best['unit']} {best['space']} {best['address']}"
    if best["odds_bits"] < LEAST_ODDS or best["bit"] is not None or best["offset"]:
        odds = f"{best['odds_bits']:.0f} bits"
        return f"which register holds the value is open: perhaps {place} ({odds}); add another"
    found.anchor(best["unit"], best["space"], best["address"], best["scale"], best["odds_bits"])
    return f"{place} x {best['scale']:g} holds the value ({best['odds_bits']:.0f} bits)"


def _answers(found: _modlens.Survey, tables: list[Table]) -> Iterator[str]:
    """The answers as JSON lines; of bits there are none."""
    for table in (table for table in tables if table["space"] in REGISTERS):
        for chunk in points(found, table):
            yield "".join(answer_line(table, learned) for learned in chunk)


def _profile(found: _modlens.Survey, tables: list[Table], source: str) -> Iterator[str]:
    """The text of the profile, some points at a time; each part is checked."""
    device = {"source": f"learned from {source}", "address_base": 0}
    yield dumps({"profile": 1, "device": device, "registers": []})
    for table in tables:
        for chunk in points(found, table):
            registers = [point_of(table, learned) for learned in chunk]
            from_model({"profile": 1, "device": device, "registers": registers}, source)
            yield point_tables(registers)


def _evidence(found: _modlens.Survey, tables: list[Table]) -> Iterator[str]:
    if found.most_rows < ALL_ROWS:
        yield f"for lack of memory, {found.most_rows} samples of each block were kept"
    for table in tables:
        yield from evidence_lines(table)
        for chunk in points(found, table):
            yield from reason_lines(table, chunk)
