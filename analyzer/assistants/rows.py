"""The tool `rows`: rows of a table that meet a condition."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from analyzer.assistants.answers import page
from analyzer.assistants.fence import Fence
from analyzer.assistants.reading import Reading
from analyzer.assistants.sorting import Sorted
from analyzer.columns import pick
from analyzer.filters import parse

__all__ = ["answer"]

LIMIT = 20

_WRITES = {"write_address", "write_quantity", "write_data"}

_DEFAULT = {
    "transactions": "txn,time,elapsed_us,bus,client,server,unit,function,address,quantity,data,"
    "write_address,write_data,fields,readings,status,exception,exception_name,response_time_us,"
    "waited_us,retry_of,findings",
    "frames": "frame,time,elapsed_us,bus,direction,unit,function,verdict,unconfirmed,gap_us,"
    "byte_length,txn,findings,hex",
}
"""The columns of an answer where none are named; of the other tables all."""


def answer(fence: Fence, arguments: Mapping[str, Any]) -> str:
    """The rows from `offset` on, at most `limit` of them, and the number of all."""
    reading = Reading(fence, arguments)
    table, wanted = arguments.get("table", "transactions"), arguments.get("columns")
    columns = pick(table, _DEFAULT.get(table) if wanted is None else _named(wanted))
    offset, limit = arguments.get("offset", 0), arguments.get("limit", LIMIT)
    order = arguments.get("sort")
    ordered = None if order is None else Sorted(table, order, offset + limit)
    total, found = 0, list[dict[str, Any]]()
    for rows in reading.rows(table, arguments.get("where")):
        start, missing = max(offset - total, 0), limit - len(found)
        if ordered is not None:
            ordered.add(rows, lambda some: _objects(some, columns))
        elif missing and start < len(rows):
            found += _objects(rows.slice(start, missing), columns)
        total += len(rows)
    if ordered is not None:
        found = ordered.rows(offset)
    head = reading.head | {"table": table}
    if wanted is not None:
        head |= _empty(columns, found)
    if not total:
        head |= _missing_dates(reading, table, arguments.get("where"))
    head |= _common_bus(found)
    return page(head, [("rows", row) for row in found], offset=offset, total=total)


def _named(text: str) -> str | None:
    return None if text.strip() == "all" else text


def _objects(rows: Any, columns: tuple[str, ...]) -> list[dict[str, Any]]:
    """The rows as objects of the columns that have a value."""
    lines = b"".join(rows.lines("jsonl", columns)).splitlines()
    return [{k: v for k, v in json.loads(line).items() if v not in ([], {})} for line in lines]


def _empty(columns: tuple[str, ...], rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The columns that were asked for and have no value in any row; rows leave them out."""
    if not rows:
        return {}
    empty = [column for column in columns if not any(column in row for row in rows)]
    writes = {f"write_{column}" for column in empty} & _WRITES
    hint = {"hint": f"writes have {', '.join(sorted(writes))}"} if writes else {}
    return {"empty_columns": empty} | hint if empty else {}


def _missing_dates(reading: Reading, table: str, where: str | None) -> dict[str, Any]:
    """A hint where a condition asks for the time of rows that have none."""
    if where is None or "time" not in parse(where, table).columns or reading.has_dates:
        return {}
    return {"hint": "its clock has no date or zone, so that no row has a time: use elapsed_us"}


def _common_bus(rows: list[dict[str, Any]]) -> dict[str, str]:
    """The bus, taken out of the rows where all have the same."""
    buses = {row.get("bus") for row in rows}
    if len(buses) != 1 or None in buses:
        return {}
    for row in rows:
        del row["bus"]
    return {"bus": buses.pop()}  # type: ignore[dict-item] # None was looked for
