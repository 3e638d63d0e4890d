"""Values for every row of the table: what hypothesis needs to build PDUs of any function."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from hypothesis import strategies as st

import _modlens
from dissectors import table, vocabulary
from dissectors.table import DIRECTIONS, Direction, Field, Function

__all__ = ["ALL_FUNCTIONS", "CASES", "ROWS", "case_id", "decoded", "encoded", "values"]

MOST_REGISTERS = 120
MOST_BITS = 960
MOST_BYTES = 60
MOST_GROUPS = 6

ALL_FUNCTIONS = _modlens.Functions()
for _vendor in vocabulary.vendors():
    ALL_FUNCTIONS.load_vendor(_vendor)

ROWS = table.functions(ALL_FUNCTIONS)
"""The embedded rows and those of all vendors."""

CASES: list[tuple[Function, Direction]] = [
    (row, direction) for row in ROWS for direction in DIRECTIONS if row.has_layout(direction)
]


def case_id(case: object) -> str:
    """Return a name for pytest."""
    return case.label if isinstance(case, Function) else str(case)


def values(row: Function, direction: Direction) -> st.SearchStrategy[dict[str, Any]]:
    """Return a strategy for the values of a body; lengths, counts and quantities are left out."""
    body = row.fields(direction)
    derived = row.quantities(direction)
    parts = {
        field.name: _field(field, row)
        for field in body
        if not field.field_type.startswith(("len", "count")) and field.name not in derived
    }
    return st.fixed_dictionaries(parts)


def decoded(pdu: bytes, direction: Direction) -> dict[str, Any]:
    """Return what the core reads: `complete`, and `fields` as name -> value."""
    tree = json.loads(ALL_FUNCTIONS.decode(pdu, direction))
    tree["fields"] = {field["name"]: field["value"] for field in tree["fields"]}
    return dict(tree)


def encoded(code: int, direction: Direction, given: Mapping[str, Any]) -> bytes:
    """Return what the core makes of the values."""
    return ALL_FUNCTIONS.encode(code, direction, json.dumps(plain(given)))


def plain(value: Any) -> Any:
    """Return the value with bytes as hex, as the border has them."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list) else value


def _field(field: Field, row: Function) -> st.SearchStrategy[Any]:
    if field.field_type == "bits":
        return st.lists(st.integers(0, 1), min_size=1, max_size=MOST_BITS)
    if field.field_type == "bytes":
        return st.binary(max_size=MOST_BYTES)
    if field.field_type == "group":
        children = {
            child.name: _field(child, row)
            for child in field.children
            if not child.field_type.startswith(("len", "count"))
        }
        return st.lists(st.fixed_dictionaries(children), max_size=MOST_GROUPS)
    if field.field_type in table.LIST_ITEM_BYTES:
        width = table.LIST_ITEM_BYTES[field.field_type]
        most = 8 if field.name == "registers" and row.operation == "other" else MOST_REGISTERS
        return st.lists(st.integers(0, 256**width - 1), min_size=1, max_size=most)
    return _number(field, row)


def _number(field: Field, row: Function) -> st.SearchStrategy[int]:
    if row.when is not None and field.name == row.when[0]:
        return st.just(row.when[1])
    if field.name in row.allowed:
        return st.sampled_from(row.allowed[field.name])
    low, high = row.limits.get(field.name, (0, 256 ** table.NUMBER_BYTES[field.field_type] - 1))
    # The general row is not for the values that have rows of their own.
    others = {
        other.when[1]
        for other in ROWS
        if other.code == row.code and other.when and other.when[0] == field.name
    }
    return st.integers(low, high).filter(lambda number: number not in others)
