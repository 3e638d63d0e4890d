"""The data of the live screen: the last rows, the values of registers, the statistics.

Memory is bounded: only so many rows and different requests are kept. Values are taken from a
transaction only when the screen is refreshed.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import _modlens
from analyzer.filters import Filter
from analyzer.views.row_lines import TableOptions

__all__ = ["LiveState", "Mark", "RegisterValue"]

MAX_ROWS = 1000
MAX_REQUESTS = 4096
HIGHLIGHT_S = 2.0
"""How long a changed value is highlighted."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A mark that the user has put into the log."""

    number: int
    text: str


@dataclass(slots=True)
class RegisterValue:
    """The value of a register or coil, and when it last changed (`time.monotonic`)."""

    value: int
    changed: float = float("-inf")

    def is_highlighted(self, now: float) -> bool:
        """Whether it changed so recently that it is highlighted."""
        return now - self.changed < HIGHLIGHT_S


RegisterKey = tuple[str, int, str, int]
"""Bus, unit, type of register, address."""


@dataclass
class LiveState:
    """Rows and statistics of a tap.

    `stats` returns the statistics so far. While `paused`, what is shown stays as it is; `filter`
    limits the log. `seen` counts the transactions.
    """

    table_options: TableOptions
    stats: Callable[[], dict[str, Any]]
    clock: Callable[[], float] = time.monotonic
    paused: bool = False
    filter: Filter | None = None
    rows: deque[_modlens.Row | Mark] = field(default_factory=lambda: deque(maxlen=MAX_ROWS))
    marks: int = 0
    seen: int = 0
    started: float = 0.0
    _requests: dict[tuple[Any, ...], tuple[_modlens.Row, bool]] = field(default_factory=dict)
    _values: dict[RegisterKey, RegisterValue] = field(default_factory=dict)
    _stats: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.started = self.clock()

    def put(self, batch: _modlens.Batch) -> None:
        """Add a batch; see `analyzer.session.Sink`."""
        table = batch.transactions
        self.seen += len(table)
        if self.paused or not len(table):
            return
        for row in table:
            self._record_request(row)
        if self.filter is not None:
            table = table.where(self.filter.predicate())
        self.rows.extend(table)

    def mark(self, text: str) -> Mark:
        """Add a mark to the log."""
        self.marks += 1
        mark = Mark(self.marks, text)
        self.rows.append(mark)
        return mark

    def refresh(self) -> None:
        """Update statistics and values, unless paused."""
        if self.paused:
            return
        self._stats = self.stats()
        now = self.clock()
        for key, (row, is_new) in self._requests.items():
            if is_new:
                self._requests[key] = (row, False)
                self._record_values(row, now)

    @property
    def statistics(self) -> dict[str, Any]:
        """The statistics of the last refresh."""
        return self._stats

    @property
    def elapsed(self) -> float:
        """Seconds since the tap began."""
        return self.clock() - self.started

    def values(self) -> dict[RegisterKey, RegisterValue]:
        """Every register and coil that was seen, sorted."""
        return dict(sorted(self._values.items()))

    def last(self, bus: str, unit: int, function: int) -> _modlens.Row | None:
        """The last transaction with values of a unit and function; None if there is none."""
        found = None
        for (name, number, code, *_), (row, _) in self._requests.items():
            if (name, number, code) == (bus, unit, function):
                found = row
        return found

    def _record_request(self, row: _modlens.Row) -> None:
        if row.status != "ok" or row.register_type is None:
            return
        key = (row.bus, row.unit, row.function, row.address, row.quantity, row.write_address)
        self._requests.pop(key, None)
        self._requests[key] = (row, True)
        if len(self._requests) > MAX_REQUESTS:
            del self._requests[next(iter(self._requests))]

    def _record_values(self, row: _modlens.Row, now: float) -> None:
        for first, data in ((row.address, row.data), (row.write_address, row.write_data)):
            if first is None or data is None:
                continue
            for address, value in enumerate(data, first):
                place = (row.bus, row.unit, row.register_type, address)
                known = self._values.get(place)
                if known is None:
                    self._values[place] = RegisterValue(value)
                elif known.value != value:
                    known.value, known.changed = value, now
