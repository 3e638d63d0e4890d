"""SQLite: the four tables in one file, with views for what is asked most often.

Numbers are numbers, times ISO-8601 text, lists joined by single spaces, maps JSON text. `PRAGMA
user_version` is the version of the columns. Views: `v_latest` (newest value of each register and
bit), `v_errors` (transactions that went wrong), `v_response_time` (by unit and function).

This is the one format that takes a Python tuple a row: SQLite's own interface demands it.
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import time
from collections.abc import Iterable
from typing import Self

import _modlens
from analyzer import exports
from analyzer.columns import TABLES, Column, columns
from analyzer.exports.output import is_special
from dissectors.errors import SourceError, UsageError
from dissectors.vocabulary import vocabulary

__all__ = ["Format"]

KEYS = {"frames": "frame", "transactions": "txn"}
TYPES = {"int": "INTEGER", "bool": "INTEGER", "us": "REAL", "float": "REAL"}

AT_ONCE = 4096
"""Rows that are tuples at the same time."""

COMMIT_S = 1.0
"""Seconds after which a live file keeps what it has, whatever happens."""

VIEWS = """
CREATE VIEW v_latest AS
  SELECT bus, unit, register_type, address, name, value, value_text, unit_of_measure, time,
    elapsed_us, operation, max(txn) AS txn
  FROM readings WHERE status IN ('ok', 'broadcast', 'unrequested')
  GROUP BY bus, unit, register_type, address;
CREATE VIEW v_errors AS
  SELECT txn, time, elapsed_us, bus, unit, function, function_name, status, exception_name,
    waited_us, findings, request_hex, response_hex
  FROM transactions WHERE status NOT IN ('ok', 'broadcast', 'not_seen');
CREATE VIEW v_response_time AS
  SELECT bus, unit, function, function_name, count(*) AS transactions,
    count(response_time_us) AS timed, min(response_time_us) AS least_us,
    avg(response_time_us) AS mean_us, max(response_time_us) AS most_us
  FROM transactions GROUP BY bus, unit, function;
"""

OF_KEPT = "DELETE FROM {} WHERE txn IS NULL OR txn NOT IN (SELECT txn FROM transactions)"


class Format(exports.Batches):
    """A database; it is its own output."""

    chosen = False

    def __init__(self, wish: exports.Wish) -> None:
        super().__init__(wish)
        self.name = ""
        self._base: sqlite3.Connection | None = None
        self._path = self._part = ""
        self._filtered = False
        self._committed = 0.0
        self._keys = {table: [column.key for column in columns(table)] for table in TABLES}

    def output(self, path: str | None, *, growing: bool) -> Self:
        """Open the database; `SourceError` if that cannot be."""
        if path is None:
            raise UsageError("a database cannot go to standard output; name a file: -o log.sqlite")
        self.name = path
        self._path = os.path.realpath(path)
        folder, base = os.path.split(self._path)
        self._part = self._path if growing else os.path.join(folder, f".{base}.{os.getpid()}")
        if growing and os.path.exists(self._path):
            raise SourceError(
                f"{path}: exists already, and a live tap never overwrites; choose another name"
            )
        if os.path.isdir(self._path):
            raise SourceError(f"{path}: is a directory; name a file in it")
        if is_special(self._path):
            raise SourceError(f"{path}: is no plain file, and a database cannot be anything else")
        try:
            self._open(growing=growing)
        except sqlite3.Error as error:
            self.abandon()
            raise self._trouble(error) from error
        return self

    def batch(self, batch: _modlens.Batch, kept: _modlens.Table | None) -> Iterable[bytes]:
        """Write the rows; nothing is left for anybody else to write."""
        if self._base is None:
            return ()
        try:
            for table in TABLES:
                rows: _modlens.Table = getattr(batch, table)
                if kept is not None and table == self.wish.table:
                    rows, self._filtered = kept, True
                self._insert(table, rows)
            if self.wish.live and time.monotonic() - self._committed > COMMIT_S:
                self._base.commit()
                self._committed = time.monotonic()
        except sqlite3.Error as error:
            self.abandon()
            raise self._trouble(error) from error
        return ()

    def append(self, data: bytes) -> None:
        """Nothing comes this way."""

    def close(self) -> None:
        """Everything into the one file, under its name."""
        if self._base is None:
            return
        try:
            if self._filtered and self.wish.table == "transactions":
                for table in ("frames", "readings", "findings"):
                    self._base.execute(OF_KEPT.format(table))
            self._base.commit()
            self._base.execute("PRAGMA journal_mode = WAL")
            self._base.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            self._base.close()
            self._base = None
            if self._part != self._path:
                os.replace(self._part, self._path)
        except (sqlite3.Error, OSError) as error:
            self.abandon()
            raise self._trouble(error) from error

    def abandon(self) -> None:
        """A whole file is taken away; a live one keeps what has been committed."""
        base, self._base = self._base, None
        if base is None:
            return
        with contextlib.suppress(sqlite3.Error):
            base.close()
        if self._part != self._path:
            for tail in ("", "-wal", "-shm", "-journal"):
                with contextlib.suppress(OSError):
                    os.unlink(self._part + tail)

    def _open(self, *, growing: bool) -> None:
        # Sinks are opened and used by one thread each, not always the same.
        base = self._base = sqlite3.connect(self._part, check_same_thread=False)
        base.execute(f"PRAGMA journal_mode = {'WAL' if growing else 'OFF'}")
        base.execute(f"PRAGMA synchronous = {'NORMAL' if growing else 'OFF'}")
        version = vocabulary()["version"]
        base.execute(f"PRAGMA user_version = {version}")
        base.execute("CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT)")
        facts = [
            ("program", "modlens"),
            ("version", _modlens.__version__),
            ("schema", str(version)),
        ]
        base.executemany("INSERT INTO meta VALUES (?, ?)", facts)
        for table in TABLES:
            parts = ", ".join(_declared(table, column) for column in columns(table))
            base.execute(f"CREATE TABLE {table} ({parts})")
        base.executescript(VIEWS)
        base.commit()

    def _insert(self, table: str, rows: _modlens.Table) -> None:
        if len(rows) and self._base is not None:
            keys = self._keys[table]
            marks = ", ".join("?" * len(keys))
            for start in range(0, len(rows), AT_ONCE):
                tuples = rows.tuples(keys, start, AT_ONCE)
                self._base.executemany(f"INSERT INTO {table} VALUES ({marks})", tuples)

    def _trouble(self, error: Exception) -> SourceError:
        return SourceError(f"{self.name}: cannot be written: {error}")


def _declared(table: str, column: Column) -> str:
    key = " PRIMARY KEY" if KEYS.get(table) == column.key else ""
    return f"{column.key} {TYPES.get(column.type, 'TEXT')}{key}"
