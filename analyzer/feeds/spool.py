"""A queue of messages for a broker, in memory or in a file.

It is an SQLite database: what was not sent before the end of the program is sent by the next run.
The number of messages is bounded; the oldest are dropped first, and counted.

>>> spool = Spool(None)
>>> spool.add(Message("plant/status", b"online", retain=True))
>>> [(number, one.topic) for number, one in spool.waiting(10)]
[(1, 'plant/status')]
>>> spool.acknowledge([1])
>>> len(spool)
0
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from dissectors.errors import SourceError

__all__ = ["Message", "Spool"]

MAX_MESSAGES = 1_000_000
"""The most messages in the queue: an hour of a busy line."""

_CHECK = 1000


@dataclass(frozen=True, slots=True)
class Message:
    """A message to a topic; `retain` makes the broker keep it for later subscribers."""

    topic: str
    payload: bytes
    retain: bool = False


class Spool:
    """A queue in a file, or in memory for None; `SourceError` if the file cannot be used.

    `dropped` counts the messages that were dropped because the queue was full.
    """

    def __init__(self, path: str | None, limit: int = MAX_MESSAGES) -> None:
        self.dropped = 0
        self._max_messages = limit
        self._last_handed_out = 0
        self._added = 0
        try:
            self._database = sqlite3.connect(path or ":memory:", isolation_level=None)
            self._database.execute("PRAGMA journal_mode=WAL")
            self._database.execute("PRAGMA synchronous=NORMAL")
            self._database.execute(
                "CREATE TABLE IF NOT EXISTS waiting"
                " (number INTEGER PRIMARY KEY AUTOINCREMENT, topic TEXT, payload BLOB,"
                " keep INTEGER)"
            )
            self._count = int(self._database.execute("SELECT count(*) FROM waiting").fetchone()[0])
        except sqlite3.Error as error:
            raise SourceError(f"{path}: cannot be used as a spool: {error}") from error

    def __len__(self) -> int:
        return self._count

    def add(self, *messages: Message) -> None:
        """Append messages; the oldest are dropped where there are more than the limit."""
        rows = [(one.topic, one.payload, one.retain) for one in messages]
        self._run("INSERT INTO waiting (topic, payload, keep) VALUES (?, ?, ?)", rows)
        self._count += len(rows)
        if self._count > self._max_messages:
            excess = self._count - self._max_messages
            self._database.execute(
                "DELETE FROM waiting WHERE number IN"
                " (SELECT number FROM waiting ORDER BY number LIMIT ?)",
                (excess,),
            )
            self._count -= excess
            self.dropped += excess

    def waiting(self, limit: int) -> list[tuple[int, Message]]:
        """The next messages that were not returned yet, with their numbers."""
        rows = self._database.execute(
            "SELECT number, topic, payload, keep FROM waiting WHERE number > ?"
            " ORDER BY number LIMIT ?",
            (self._last_handed_out, limit),
        ).fetchall()
        if rows:
            self._last_handed_out = int(rows[-1][0])
        return [(int(row[0]), Message(row[1], row[2], bool(row[3]))) for row in rows]

    def acknowledge(self, numbers: Iterable[int]) -> None:
        """Remove messages that the broker has acknowledged."""
        rows = [(number,) for number in numbers]
        before = self._database.total_changes
        self._run("DELETE FROM waiting WHERE number = ?", rows)
        self._count -= self._database.total_changes - before

    def close(self) -> None:
        """Close the queue; waiting messages stay in the file."""
        self._database.close()

    def _run(self, text: str, rows: Sequence[tuple[Any, ...]]) -> None:
        if not rows:
            return
        try:
            self._database.execute("BEGIN")
            self._database.executemany(text, rows)
            self._database.execute("COMMIT")
        except sqlite3.Error as error:
            raise SourceError(f"the spool cannot be written: {error}") from error
