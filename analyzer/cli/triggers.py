"""Stop conditions of a tap, files around events, and the hourly summary.

All of them are sinks: they see the decoded batches and do not change them.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import _modlens
from analyzer.counts import count_of
from analyzer.exports.sink import ExportSink, Target
from analyzer.filters import parse

__all__ = ["EventCapture", "HourlySummary", "SettingsDoubt", "StopConditions"]

HOUR_S = 3600.0
DOUBT_S = 1.0
MIN_BYTES = 24


class StopConditions:
    """Ends a tap after `count` transactions, `duration` seconds, or a row that matches `until`.

    `reached` is True once one of them is met. `FilterError` if `until` is not a valid filter.
    """

    name = "limits"

    def __init__(self, count: int | None, duration: float | None, until: str | None) -> None:
        self.reached = False
        self._remaining = count
        self._until = None if until is None else parse(until, "transactions").predicate()
        self._deadline_s = None if duration is None else time.monotonic() + duration

    @property
    def any_set(self) -> bool:
        """Whether there is any condition."""
        return not (self._remaining is None and self._until is None and self._deadline_s is None)

    def put(self, batch: _modlens.Batch) -> None:
        """Check the conditions with one more batch."""
        if self._remaining is not None:
            self._remaining -= len(batch.transactions)
            self.reached |= self._remaining <= 0
        if self._until is not None and len(batch.transactions):
            self.reached |= len(batch.transactions.where(self._until)) > 0
        if self._deadline_s is not None:
            self.reached |= time.monotonic() >= self._deadline_s


class EventCapture:
    """Writes `context` transactions before and after each one that matches `where`.

    Each event gets a file of its own: `target`'s name with a number. An event that follows within
    `context` transactions of another goes into the same file.
    """

    def __init__(self, context: int, where: str, target: Target, columns: str | None) -> None:
        self.name = str(target.path)
        self.table = target.table
        self.row_count = 0
        self.events = 0
        self._context = context
        self._predicate = parse(where, "transactions").predicate()
        self._target, self._columns = target, columns
        self._buffer: deque[_modlens.Batch] = deque()
        self._buffered_transactions = 0
        self._sink: ExportSink | None = None
        self._remaining_transactions = 0

    def put(self, batch: _modlens.Batch) -> None:
        """Write the batch if an event is near, otherwise buffer it for the next event."""
        count = len(batch.transactions)
        event = count > 0 and len(batch.transactions.where(self._predicate)) > 0
        if event and self._sink is None:
            self.events += 1
            self._sink = self._open_next_file()
            for kept in self._buffer:
                self._sink.put(kept)
            self._buffer.clear()
            self._buffered_transactions = 0
        if self._sink is None:
            self._append_to_buffer(batch, count)
            return
        self._sink.put(batch)
        self._remaining_transactions = (
            self._context if event else self._remaining_transactions - count
        )
        if self._remaining_transactions <= 0:
            self.close()

    def close(self) -> None:
        """Complete the file of the current event, if there is one."""
        if self._sink is not None:
            self._sink.close()
            self.row_count += self._sink.row_count
            self._sink = None

    def rollback(self) -> None:
        """Discard the file of the current event, if there is one."""
        if self._sink is not None:
            self._sink.rollback()
            self._sink = None

    def _append_to_buffer(self, batch: _modlens.Batch, count: int) -> None:
        """Add a batch to the buffer and drop the oldest batches that are no longer needed.

        Whole batches are kept, so the buffer has a few transactions more than `context`, never
        fewer.
        """
        if not (count or len(batch.frames)):
            return
        self._buffer.append(batch)
        self._buffered_transactions += count
        while (
            self._buffer
            and self._buffered_transactions - len(self._buffer[0].transactions) >= self._context
        ):
            self._buffered_transactions -= len(self._buffer.popleft().transactions)

    def _open_next_file(self) -> ExportSink:
        path = PurePath(str(self._target.path))
        numbered = path.with_name(f"{path.stem}-{self.events:04d}{path.suffix}")
        target = replace(self._target, path=str(numbered))
        return ExportSink(target, columns=self._columns, where=None, growing=True)


class HourlySummary:
    """Reports once an hour how many frames and transactions the hour brought.

    `stats` returns the statistics so far, with the keys described in views/stats.py.
    """

    name = "the hourly summary"

    def __init__(
        self,
        stats: Callable[[], Mapping[str, Any]],
        say: Callable[[str], None],
        period_s: float = HOUR_S,
    ) -> None:
        self._stats, self._say, self._period_s = stats, say, period_s
        self._next_s = time.monotonic() + period_s
        self._buffer: dict[str, int] = {}
        self._frames = 0

    def put(self, batch: _modlens.Batch) -> None:
        """Report if the hour is over."""
        if time.monotonic() < self._next_s:
            return
        self._next_s += self._period_s
        stats = self._stats()
        counts = dict(stats["transactions"])
        new_counts = {name: count - self._buffer.get(name, 0) for name, count in counts.items()}
        frames = sum(sum(bus["frames"].values()) for bus in stats["buses"])
        states = ", ".join(f"{name} {count:,}" for name, count in new_counts.items() if count)
        total = sum(new_counts.values())
        self._say(
            f"{time.strftime('%Y-%m-%d %H:%M')}: {count_of(frames - self._frames, 'frame')},"
            f" {count_of(total, 'transaction')}{': ' + states if states else ''}"
            " since the last summary"
        )
        self._buffer, self._frames = counts, frames


class SettingsDoubt:
    """Says once for each bus that its line settings are probably wrong.

    That is so where bytes have come for a second and none of them was in a valid frame.
    """

    name = "the doubt about line settings"

    def __init__(
        self,
        stats: Callable[[], Mapping[str, Any]],
        say: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stats, self._say, self._clock = stats, say, clock
        self._next_s = clock() + DOUBT_S
        self._bytes_before: dict[str, int] = {}
        self._settled: set[str] = set()

    def put(self, batch: _modlens.Batch) -> None:
        """Look once a second at the buses that have shown no valid frame yet."""
        if self._clock() < self._next_s:
            return
        self._next_s = self._clock() + DOUBT_S
        if self._settled and len(self._settled) == len(self._bytes_before):
            return
        for bus in self._stats()["buses"]:
            name, received = bus["bus"], sum(bus["bytes"].values())
            before = self._bytes_before.get(name, 0)
            self._bytes_before[name] = received
            if name in self._settled:
                continue
            if bus["frames"]["ok"]:
                self._settled.add(name)
            elif before >= MIN_BYTES and received > before:
                self._settled.add(name)
                self._say(
                    f"{name}: traffic, but no valid frame in {received:,} bytes: the line settings"
                    " are probably wrong; without --line they are found by listening"
                )
