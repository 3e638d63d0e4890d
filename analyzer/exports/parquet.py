"""Parquet: zstd, dictionaries where values are few, times as timestamp[ns, UTC].

The metadata name the table (`modlens.table`), the version of its columns (`modlens.schema_version`)
and that of the program. The style `partitions` makes a folder instead of a file, as
`log.parquet/date=2026-11-21/bus=ttyUSB0/part-0.parquet`: what Hive, Spark, polars and duckdb read
as one table.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import ClassVar
from urllib.parse import quote

import _modlens
from analyzer import exports
from analyzer.exports.output import AtomicFile, Output
from dissectors.errors import SourceError, UsageError

__all__ = ["Format"]

PARTITIONS = "partitions"
NO_DATE = "__HIVE_DEFAULT_PARTITION__"
"""The name that Hive and compatible programs give to a partition without a value."""


class Format(exports.Format):
    """A Parquet file of some columns of one table."""

    name = "parquet"
    styles: ClassVar[Sequence[str]] = ("file", PARTITIONS)
    readable_while_written = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        row_file = getattr(_modlens, "RowFile", None)
        if row_file is None:
            raise UsageError(
                f"{self.name}: this build of modlens does not include it (feature `files`)"
            )
        self._new_file: Callable[[], _modlens.RowFile] = lambda: row_file(
            self.name, options.table, options.columns
        )
        self._file: _modlens.RowFile = self._new_file()
        self._folder: _PartitionedOutput | None = None

    def output(self, path: str | None, *, growing: bool) -> Output:
        """Open a file, or for the style `partitions` a folder, which must not exist yet."""
        if self.options.style != PARTITIONS:
            return super().output(path, growing=growing)
        if path is None:
            raise UsageError("--style partitions: a folder cannot go to standard output; add -o")
        self._folder = _PartitionedOutput(path, self._new_file)
        return self._folder

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode rows; gives the completed row groups, which have 65,536 rows."""
        if self._folder is not None:
            self._folder.write(table)
            return b""
        return self._file.rows(table)

    def footer(self) -> bytes:
        """The last row group and the footer of the file."""
        return b"" if self._folder is not None else self._file.end()


class _PartitionedOutput:
    """A folder with a file for each day and bus, in subfolders `date=.../bus=...`."""

    def __init__(self, path: str, new_file: Callable[[], _modlens.RowFile]) -> None:
        self.name = path
        self._new_file = new_file
        self._files: dict[str, tuple[_modlens.RowFile, AtomicFile]] = {}
        try:
            os.mkdir(path)
        except OSError as error:
            raise SourceError(
                f"{path}: no new folder can be created there: {error.strerror}"
            ) from error

    def write(self, table: _modlens.Table) -> None:
        """Write each row to the file of its day and bus."""
        for date, bus, rows in table.partitions():
            folder = os.path.join(f"date={date or NO_DATE}", f"bus={quote(bus, safe='')}")
            if folder not in self._files:
                os.makedirs(os.path.join(self.name, folder), exist_ok=True)
                path = os.path.join(self.name, folder, "part-0.parquet")
                self._files[folder] = (self._new_file(), AtomicFile(path))
            row_file, output = self._files[folder]
            output.append(row_file.rows(rows))

    def append(self, data: bytes) -> None:
        """Nothing to do: the rows are written by `write`."""

    def close(self) -> None:
        """Complete all files."""
        for row_file, output in self._files.values():
            output.append(row_file.end())
            output.close()

    def rollback(self) -> None:
        """Delete all incomplete files; their folders stay."""
        for _, output in self._files.values():
            output.rollback()
