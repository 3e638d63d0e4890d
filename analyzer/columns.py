"""The columns of the tables, as the core has read them from columns.toml.

>>> [column.key for column in columns("findings")][:4]
['frame', 'txn', 'time', 'elapsed_us']
>>> pick("frames", "frame, unit,verdict")
('frame', 'unit', 'verdict')
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import cache

import _modlens
from dissectors.errors import UsageError
from dissectors.texts import respelled, vocabulary

__all__ = ["TABLES", "Column", "columns", "pick"]

TABLES = ("transactions", "frames", "readings", "findings", "connections", "diagnoses")
"""The tables; the first one is the default."""


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table.

    `key` names it in every output and filter, `type` is a word of columns.toml; `title` and `help`
    are for people. `always` says that every row has a value.
    """

    key: str
    type: str
    title: str
    help: str
    always: bool = False


@cache
def _all() -> dict[str, tuple[Column, ...]]:
    tables = vocabulary("columns")
    return {name: tuple(Column(**row) for row in rows) for name, rows in tables.items()}


def columns(table: str) -> tuple[Column, ...]:
    """Every column of a table, in the order of every output.

    `UsageError` if there is no such table.
    """
    found = _all().get(table)
    if found is None:
        raise UsageError(f"no table {table!r}; the tables are {', '.join(TABLES)}")
    return found


def _meant(word: str, table: str) -> str | None:
    """Returns the column that other programs call so, as filters know them: `unit` for `slave`."""
    if not word.isidentifier():
        return None
    found = json.loads(_modlens.parse_filter(f"{word} is None", table, lambda: []))
    match = re.search(r"write `(\w+)`", found.get("error", ""))
    return match and match[1]


def pick(table: str, text: str | None) -> tuple[str, ...]:
    """Parse `a,b,c` into column keys, in that order; all keys of the table where `text` is None.

    A key may have its former spelling. `UsageError` names an unknown column and the nearest
    known one.
    """
    known = [column.key for column in columns(table)]
    if text is None:
        return tuple(known)
    wanted = [respelled("column", part.strip()) for part in text.split(",") if part.strip()]
    if not wanted:
        raise UsageError(
            f"--columns names no column; the columns of {table} are {', '.join(known)}"
        )
    for key in wanted:
        if key not in known:
            from dissectors.function_lookup import similar_name  # noqa: PLC0415 - a message only

            meant, hint = _meant(key, table), similar_name(key, known)
            question = (
                f"; write {meant!r}"
                if meant in known
                else f"; did you mean {hint!r}?"
                if hint
                else f"; the columns are {', '.join(known)}"
            )
            raise UsageError(f"no column {key!r} in {table}{question}")
    return tuple(wanted)
