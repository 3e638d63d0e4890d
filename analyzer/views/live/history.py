"""The log of the live screen: the last transactions and marks, filtered, and the part shown."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import _modlens
from analyzer.filters import Filter

__all__ = ["History", "Mark"]

MAX_ROWS = 5000
"""Transactions that are kept; the oldest go first."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A line in the log that is no transaction: what the user marked, or what is not kept."""

    text: str


class History:
    """The last transactions and marks, oldest first, and which of them are shown.

    `filter` chooses among all that are kept, also those that came before it was set.
    """

    def __init__(self) -> None:
        self.filter: Filter | None = None
        self.marks = 0
        self._kept: deque[_modlens.Table | Mark] = deque()
        self._kept_rows = 0
        self._forgotten = 0
        self._shown: deque[_modlens.Row | Mark] = deque()
        # Rows that have gone from the front of `_shown`: places are counted from the very first.
        self._gone = 0
        self._end: int | None = None

    def __len__(self) -> int:
        return len(self._shown)

    @property
    def is_at_end(self) -> bool:
        """Whether the newest row is shown, and rows move up as others come."""
        return self._end is None

    def add(self, table: _modlens.Table) -> None:
        """Add transactions; the oldest are forgotten where there are too many."""
        self._kept.append(table)
        self._kept_rows += len(table)
        self._show(table)
        while self._kept_rows > MAX_ROWS and len(self._kept) > 1:
            self._forget(self._kept.popleft())

    def mark(self, text: str) -> Mark:
        """Add a mark at the end, with the next number."""
        self.marks += 1
        mark = Mark(f"mark {self.marks} {text}")
        self._kept.append(mark)
        self._show(mark)
        return mark

    def set_filter(self, wanted: Filter | None) -> None:
        """Show only what matches, of all that is kept; None shows everything."""
        self.filter = wanted
        self._gone += len(self._shown)
        self._shown.clear()
        self._end = None
        for one in self._kept:
            self._show(one)

    def hold(self, *, held: bool) -> None:
        """Stay at the rows that are shown now, or go back to the newest."""
        self._end = self._gone + len(self._shown) if held else None

    def turn(self, rows: int, room: int) -> None:
        """Go so many rows towards the newest, back for a negative number; `room` rows are shown."""
        newest = self._gone + len(self._shown)
        end = (newest if self._end is None else self._end) + rows
        self._end = None if end >= newest else max(end, self._gone + room)

    def page(self, room: int) -> tuple[list[_modlens.Row | Mark], int]:
        """The rows that fit into so many lines, and the place of the first, counted from 1.

        In front of the oldest stands how many are no longer kept.
        """
        end = len(self._shown) if self._end is None else self._end - self._gone
        first = min(max(end - room, 0), len(self._shown))
        rows = [self._shown[at] for at in range(first, min(first + room, len(self._shown)))]
        if not first and self._forgotten:
            rows.insert(0, Mark(f"{self._forgotten:,} older transactions are no longer kept"))
            rows = rows[:room]
        return rows, first + 1

    def _show(self, one: _modlens.Table | Mark) -> None:
        if isinstance(one, Mark):
            self._shown.append(one)
        else:
            self._shown.extend(self._matching(one))

    def _matching(self, table: _modlens.Table) -> _modlens.Table:
        return table if self.filter is None else table.where(self.filter.predicate())

    def _forget(self, one: _modlens.Table | Mark) -> None:
        count = 1 if isinstance(one, Mark) else len(self._matching(one))
        if not isinstance(one, Mark):
            self._kept_rows -= len(one)
            self._forgotten += len(one)
        for _ in range(min(count, len(self._shown))):
            self._shown.popleft()
            self._gone += 1
