"""SQLite: all tables in one file, with views for what is asked most often.

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
from analyzer.exports.output import is_special, partial_name
from dissectors.errors import SourceError, UsageError
from dissectors.texts import vocabulary

__all__ = ["Format"]

PRIMARY_KEYS = {"frames": "frame", "transactions": "txn", "connections": "connection"}
SQL_TYPES = {"int": "INTEGER", "bool": "INTEGER", "us": "REAL", "float": "REAL"}

ROWS_PER_INSERT = 4096
"""Rows that are converted to tuples at a time."""

COMMIT_S = 1.0
"""Seconds between two commits of a live file: the most that can be lost."""

MERGE_MS = 1000
"""Milliseconds for which the end of a live file waits for other programs that read it."""

VIEWS = """
CREATE VIEW v_latest AS
  SELECT bus, unit, register_type, address, name, value, value_text, unit_of_measure, time,
    elapsed_us, operation, max(txn) AS txn
  FROM readings WHERE status IN ('ok', 'broadcast', 'unsolicited')
  GROUP BY bus, unit, register_type, address;
CREATE VIEW v_errors AS
  SELECT txn, time, elapsed_us, bus, unit, function, function_name, status, exception_name,
    waited_us, findings, request_hex, response_hex
  FROM transactions WHERE status NOT IN ('ok', 'broadcast', 'not_observed');
CREATE VIEW v_response_time AS
  SELECT bus, unit, function, function_name, count(*) AS transactions,
    count(response_time_us) AS timed, min(response_time_us) AS least_us,
    avg(response_time_us) AS mean_us, max(response_time_us) AS most_us
  FROM transactions GROUP BY bus, unit, function;
"""

DELETE_OF_OTHER_TRANSACTIONS = (
    "DELETE FROM {} WHERE txn IS NULL OR txn NOT IN (SELECT txn FROM transactions)"
)


class Format(exports.MultiTableFormat):
    """A database; it is its own output, because SQLite writes the file itself."""

    has_column_choice = False
    any_thread = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self.name = self.remark = ""
        self._database: sqlite3.Connection | None = None
        self._path = self._temporary_path = ""
        self._filtered = False
        self._remark = ""
        self._committed_s = 0.0
        self._keys = {table: [column.key for column in columns(table)] for table in TABLES}

    def output(self, path: str | None, *, growing: bool) -> Self:
        """Open the database; `SourceError` if that fails."""
        if path is None:
            raise UsageError("a database cannot go to standard output; name a file: -o log.sqlite")
        self.name = path
        self._path = os.path.realpath(path)
        folder, database = os.path.split(self._path)
        self._temporary_path = (
            self._path if growing else os.path.join(folder, f".{database}.{os.getpid()}")
        )
        if growing and os.path.exists(self._path):
            raise SourceError(
                f"{path}: already exists, and a live tap never overwrites; choose another name"
            )
        if os.path.isdir(self._path):
            raise SourceError(f"{path}: is a directory; name a file in it")
        if is_special(self._path):
            raise SourceError(f"{path}: is not a regular file, which a database must be")
        try:
            self._open(growing=growing)
        except sqlite3.Error as error:
            self.rollback()
            raise self._source_error(error) from error
        return self

    def encode_batch(self, batch: _modlens.Batch, kept: _modlens.Table | None) -> Iterable[bytes]:
        """Insert the rows; gives no bytes, because SQLite writes the file itself."""
        if self._database is None:
            return ()
        try:
            for table in TABLES:
                rows: _modlens.Table = getattr(batch, table)
                if kept is not None and table == self.options.table:
                    rows, self._filtered = kept, True
                self._insert(table, rows)
            if self.options.live and time.monotonic() - self._committed_s > COMMIT_S:
                self._database.commit()
                self._committed_s = time.monotonic()
        except sqlite3.Error as error:
            self.rollback()
            raise self._source_error(error) from error
        return ()

    def append(self, data: bytes) -> None:
        """Nothing to do: the rows are written by `encode_batch`."""

    def close(self, *, interrupted: bool = False) -> None:
        """Commit, merge the write-ahead log into the file, and give the file its name.

        A finished database has no write-ahead log: SQLite opens one that has it in a writable
        folder only.
        """
        if self._database is None:
            return
        if interrupted and self._temporary_path != self._path:
            shown = self._path if os.path.islink(self.name) else self.name
            self.name, self._path = partial_name(shown), partial_name(self._path)
        try:
            if self._filtered and self.options.table == "transactions":
                for table in ("frames", "readings", "findings"):
                    self._database.execute(DELETE_OF_OTHER_TRANSACTIONS.format(table))
            self._database.commit()
            self._merge_log(self._database)
            self._database.close()
            self._database = None
            if self._temporary_path != self._path:
                os.replace(self._temporary_path, self._path)
        except (sqlite3.Error, OSError) as error:
            self.rollback()
            raise self._source_error(error) from error

    def rollback(self) -> None:
        """Delete the incomplete file; a live file keeps what has been committed."""
        database, self._database = self._database, None
        if database is None:
            return
        with contextlib.suppress(sqlite3.Error):
            database.close()
        if self._temporary_path != self._path:
            for tail in ("", "-wal", "-shm", "-journal"):
                with contextlib.suppress(OSError):
                    os.unlink(self._temporary_path + tail)

    def _open(self, *, growing: bool) -> None:
        """Create the database with its tables, views and metadata.

        A file that grows uses a write-ahead log, so that it can be read meanwhile; one that is
        renamed when it is complete needs no journal.
        """
        # A sink is used by one thread at a time, but may be opened in another one.
        database = self._database = sqlite3.connect(self._temporary_path, check_same_thread=False)
        database.execute(f"PRAGMA journal_mode = {'WAL' if growing else 'OFF'}")
        database.execute(f"PRAGMA synchronous = {'NORMAL' if growing else 'OFF'}")
        version = vocabulary("version")
        database.execute(f"PRAGMA user_version = {version}")
        database.execute("CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT)")
        metadata = [
            ("program", "modlens"),
            ("version", _modlens.__version__),
            ("schema", str(version)),
        ]
        database.executemany("INSERT INTO meta VALUES (?, ?)", metadata)
        for table in TABLES:
            parts = ", ".join(_column_declaration(table, column) for column in columns(table))
            database.execute(f"CREATE TABLE {table} ({parts})")
        database.executescript(VIEWS)
        database.commit()

    def _merge_log(self, database: sqlite3.Connection) -> None:
        """Merge the write-ahead log into the file, and leave WAL mode unless somebody reads it."""
        database.execute(f"PRAGMA busy_timeout = {MERGE_MS}")
        try:
            (mode,) = database.execute("PRAGMA journal_mode = DELETE").fetchone()
        except sqlite3.OperationalError:
            mode = "wal"
        if mode == "wal":
            database.execute("PRAGMA wal_checkpoint(PASSIVE)")
            self._remark = "another program has it open, so it stays in WAL mode"

    def closing_remark(self) -> str:
        """Whether the finished file needs a writable folder because it is still in WAL mode."""
        return self._remark

    def _insert(self, table: str, rows: _modlens.Table) -> None:
        if len(rows) and self._database is not None:
            keys = self._keys[table]
            marks = ", ".join("?" * len(keys))
            for start in range(0, len(rows), ROWS_PER_INSERT):
                tuples = rows.tuples(keys, start, ROWS_PER_INSERT)
                self._database.executemany(f"INSERT INTO {table} VALUES ({marks})", tuples)

    def _source_error(self, error: Exception) -> SourceError:
        return SourceError(f"{self.name}: cannot be written: {error}")


def _column_declaration(table: str, column: Column) -> str:
    key = " PRIMARY KEY" if PRIMARY_KEYS.get(table) == column.key else ""
    return f"{column.key} {SQL_TYPES.get(column.type, 'TEXT')}{key}"
