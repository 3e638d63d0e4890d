"""The survey of registers that `learn` and `match` work on."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import _modlens
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.find import Search
from analyzer.cli.messages import Messages
from dissectors.errors import UsageError

__all__ = ["chosen_unit", "chunks", "points", "survey", "tables_of"]

Table = Mapping[str, Any]

CHUNK = 1024
"""The rows that are objects of Python at a time."""


def survey(
    options: argparse.Namespace, search: Search | None = None, *, quiet: bool = False
) -> _modlens.Survey:
    """Survey the registers in the input files; what is searched in them gets all batches, too."""
    messages = Messages(quiet=quiet)
    chosen = replace(settings(options), tables=("transactions",))
    files = file_run(options, chosen, messages)
    found = _modlens.Survey()
    for batch in files.batches():
        found.add(batch)
        if search is not None:
            search.add(batch)
    return found


def tables_of(found: _modlens.Survey) -> list[Table]:
    """What was asked for in each table of each unit."""
    tables: list[Table] = json.loads(found.tables())
    return tables


def points(found: _modlens.Survey, table: Table) -> Iterator[list[dict[str, Any]]]:
    """What was learned of the points of a table, some of them at a time."""
    return chunks(partial(found.points, table["unit"], table["space"]))


def chunks(core: Callable[[int, int], str]) -> Iterator[list[dict[str, Any]]]:
    """Rows of the core, some of them at a time: `core` gives so many from a place on, as JSON."""
    first = 0
    while chunk := json.loads(core(first, CHUNK)):
        yield chunk
        first += CHUNK


def chosen_unit(tables: list[Table], unit: int | None, command: str) -> int:
    """The unit to work on; `UsageError` where several units were seen and none is chosen."""
    units = sorted({table["unit"] for table in tables})
    if unit is None and len(units) == 1:
        return int(units[0])
    if unit is None or unit not in units:
        there = f"there are {', '.join(map(str, units))}" if units else "no unit answered"
        raise UsageError(f"{command}: choose a unit with --unit N; {there}")
    return unit
