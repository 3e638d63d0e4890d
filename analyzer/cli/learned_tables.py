"""What `modlens learn` finds out about the registers of recordings, as rows for the report."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import _modlens
from analyzer.cli.register_survey import Table, points, survey, tables_of
from analyzer.report.strips import band, states
from analyzer.views.learned import (
    chance_of,
    is_silent,
    open_questions,
    order_text,
    span_text,
    unit_text,
    values_text,
)

__all__ = ["learned_tables"]

REGISTERS = ("ir", "hr")

MOST_PARTS = 60
"""A strip shows the time in so many parts, or in fewer where there are many registers."""

MOST_SPANS = 1 << 18
MOST_VALUES = 2000
"""What is kept of a table, at most."""

_STATES = ("enum", "bit field", "setpoint")


def learned_tables(options: argparse.Namespace) -> list[dict[str, Any]]:
    """What is open, the values and the equations of each table of registers."""
    found = survey(options, quiet=True)
    tables = [table for table in tables_of(found) if table["space"] in REGISTERS]
    return [_table(found, table, options.files[0]) for table in tables]


def _table(found: _modlens.Survey, table: Table, source: str) -> dict[str, Any]:
    unit, space = table["unit"], table["space"]
    rows = [one for chunk in points(found, table) for one in chunk]
    parts = max(1, min(MOST_PARTS, MOST_SPANS // len(rows))) if rows else 1
    moved = json.loads(found.movements(unit, space, parts))
    return {
        "unit": unit,
        "open": [
            {"what": what, "registers": f"{space} {registers}", "how": how}
            for what, registers, how in open_questions(rows, source)
        ],
        "values": list(islice(_values(space, rows, moved["spans"]), MOST_VALUES)),
        "equations": [
            {"equation": _equation(space, one), "residual": one["residual"]}
            for one in moved["equations"]
        ],
    }


def _values(
    space: str, rows: Sequence[Mapping[str, Any]], spans: Sequence[Sequence[Any]]
) -> Iterator[dict[str, Any]]:
    for one, strip in zip(rows, spans, strict=True):
        if is_silent(one):
            continue
        moves = one["changes"] and any(strip)
        drawn = states if one["role"] in _STATES else band
        yield {
            "registers": f"{space} {span_text(one)}",
            "type": f"{one['type']}{order_text(one)}",
            "role": one["role"] or "undecided",
            "strip": drawn(strip) if moves else [],
            "values": values_text(one),
            "unit_of_measure": unit_text(one),
            "chance": chance_of(one),
            "why": "; ".join(reason for reason in (one["scale_reason"], one["reason"]) if reason),
        }


def _equation(space: str, one: Mapping[str, Any]) -> str:
    """An equation as text, such as `hr 6 = 0.00095 x hr 0 x hr 3`."""
    terms = [f"{space} {address}" for address in one["of"]]
    factor = "" if one["factor"] == 1 else f"{one['factor']:.4g} x "
    joined = {"sum": " + ", "product": " x ", "integral": ""}[one["kind"]].join(terms)
    if one["kind"] == "integral":
        joined = f"integral of {joined} over hours"
    elif one["kind"] == "sum" and factor:
        joined = f"({joined})"
    return f"{space} {one['address']} = {factor}{joined}"
