"""The rows with the smallest or largest values of a column, out of more than memory holds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import _modlens
from analyzer.columns import pick
from dissectors.errors import UsageError

__all__ = ["DEEPEST", "Sorted"]

DEEPEST = 1_000
"""Rows that are kept; a page beyond them needs a condition that leaves fewer rows."""

Row = dict[str, Any]
_Key = tuple[bool, bool, Any]


class Sorted:
    """Keeps the first rows in the order of a column; rows without a value are the last ones.

    `order` is the name of a column of the table, after `-` for the largest values first. Rows with
    equal values stay in the order of the recording.
    """

    def __init__(self, table: str, order: str, depth: int) -> None:
        if depth > DEEPEST:
            raise UsageError(
                f"sort: the first {DEEPEST} rows are kept; choose fewer rows with where"
            )
        self._descends = order.startswith("-")
        self._column = pick(table, order.removeprefix("-"))
        if len(self._column) > 1:
            raise UsageError("sort: name one column")
        self._depth = depth
        self._kept: list[tuple[_Key, Row]] = []

    def add(self, rows: _modlens.Table, objects: Callable[[_modlens.Table], list[Row]]) -> None:
        """Takes the rows that belong to the first ones so far, as the objects made of them."""
        keys = [self._key(value) for (value,) in rows.tuples(self._column)]
        merged: list[tuple[_Key, Row | int]] = [*self._kept]
        merged += [(key, at) for at, key in enumerate(keys)]
        merged.sort(key=lambda one: one[0], reverse=self._descends)
        self._kept = [
            (key, objects(rows.slice(row, 1))[0] if isinstance(row, int) else row)
            for key, row in merged[: self._depth]
        ]

    def rows(self, start: int) -> list[Row]:
        """The rows from this place on."""
        return [row for _, row in self._kept[start:]]

    def _key(self, value: Any) -> _Key:
        """Numbers before texts; of times, the fraction of a second has as many digits as needed."""
        is_text = isinstance(value, str)
        comparable = value.removesuffix("Z") if is_text else value or 0
        return ((value is None) is not self._descends, is_text, comparable)
