"""What ends a tap by itself, what is written around events, and the summary of each hour.

All of them are sinks: they see what is decided and decide nothing about it.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import _modlens
from analyzer.exports.sink import ExportSink, Target
from analyzer.filters import parse

__all__ = ["Around", "Hourly", "Limits"]

HOUR_S = 3600.0


class Limits:
    """Ends a tap after `count` transactions, `duration` seconds, or a row for which `until` holds.

    `FilterError` for an `until` that means nothing.
    """

    name = "limits"

    def __init__(self, count: int | None, duration: float | None, until: str | None) -> None:
        self.reached = False
        self._left = count
        self._until = None if until is None else parse(until, "transactions").predicate()
        self._end = None if duration is None else time.monotonic() + duration

    @property
    def set(self) -> bool:
        """Whether there is any."""
        return not (self._left is None and self._until is None and self._end is None)

    def put(self, batch: _modlens.Batch) -> None:
        """Count and compare."""
        if self._left is not None:
            self._left -= len(batch.transactions)
            self.reached |= self._left <= 0
        if self._until is not None and len(batch.transactions):
            self.reached |= len(batch.transactions.where(self._until)) > 0
        if self._end is not None:
            self.reached |= time.monotonic() >= self._end


class Around:
    """Writes `many` transactions before and after each one for which `where` holds.

    A file for each event, `target`'s name with a number; an event that follows within `many` goes
    into the same file.
    """

    def __init__(self, many: int, where: str, target: Target, columns: str | None) -> None:
        self.name = str(target.path)
        self.table = target.table
        self.rows = 0
        self.events = 0
        self._many = many
        self._predicate = parse(where, "transactions").predicate()
        self._target, self._columns = target, columns
        self._before: deque[_modlens.Batch] = deque()
        self._kept = 0
        self._sink: ExportSink | None = None
        self._after = 0

    def put(self, batch: _modlens.Batch) -> None:
        """Keep it, or write it where an event is near."""
        count = len(batch.transactions)
        event = count > 0 and len(batch.transactions.where(self._predicate)) > 0
        if event and self._sink is None:
            self.events += 1
            self._sink = self._open()
            for kept in self._before:
                self._sink.put(kept)
            self._before.clear()
            self._kept = 0
        if self._sink is None:
            self._keep(batch, count)
            return
        self._sink.put(batch)
        self._after = self._many if event else self._after - count
        if self._after <= 0:
            self.close()

    def close(self) -> None:
        """The file of the event that is being written is complete."""
        if self._sink is not None:
            self._sink.close()
            self.rows += self._sink.rows
            self._sink = None

    def abandon(self) -> None:
        """Leave what is written."""
        if self._sink is not None:
            self._sink.abandon()
            self._sink = None

    def _keep(self, batch: _modlens.Batch, count: int) -> None:
        """Whole batches: a few transactions more than asked for, never fewer."""
        if not (count or len(batch.frames)):
            return
        self._before.append(batch)
        self._kept += count
        while self._before and self._kept - len(self._before[0].transactions) >= self._many:
            self._kept -= len(self._before.popleft().transactions)

    def _open(self) -> ExportSink:
        path = PurePath(str(self._target.path))
        numbered = path.with_name(f"{path.stem}-{self.events:04d}{path.suffix}")
        target = replace(self._target, path=str(numbered))
        return ExportSink(target, columns=self._columns, where=None, growing=True)


class Hourly:
    """Says once an hour what the hour brought; `stats` as in views/stats.py."""

    name = "the hourly summary"

    def __init__(
        self,
        stats: Callable[[], Mapping[str, Any]],
        say: Callable[[str], None],
        every: float = HOUR_S,
    ) -> None:
        self._stats, self._say, self._every = stats, say, every
        self._next = time.monotonic() + every
        self._before: dict[str, int] = {}
        self._frames = 0

    def put(self, batch: _modlens.Batch) -> None:
        """Look at the clock."""
        if time.monotonic() < self._next:
            return
        self._next += self._every
        stats = self._stats()
        now = dict(stats["transactions"])
        gained = {name: count - self._before.get(name, 0) for name, count in now.items()}
        frames = sum(sum(bus["frames"].values()) for bus in stats["buses"])
        states = ", ".join(f"{name} {count:,}" for name, count in gained.items() if count)
        total = sum(gained.values())
        self._say(
            f"{time.strftime('%Y-%m-%d %H:%M')}: {frames - self._frames:,} frames,"
            f" {total:,} transactions{': ' + states if states else ''} since the last summary"
        )
        self._before, self._frames = now, frames
