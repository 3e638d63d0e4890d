"""Parquet: zstd, dictionaries where values are few, times as timestamp[ns, UTC].

The metadata name the table (`modlens.table`), the version of its columns (`modlens.schema_version`)
and that of the program. The style `partitions` makes a folder instead of a file, as
`log.parquet/date=2026-11-21/bus=ttyUSB0/part-0.parquet`: what Hive, Spark, pandas, pyarrow, polars
and duckdb read as one table. The column `bus` is in the path only, as Hive has it: pyarrow
refuses a dataset whose path and files both have a column of that name.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Sequence
from typing import ClassVar
from urllib.parse import quote

import _modlens
from analyzer import exports
from analyzer.exports.output import AtomicFile, Output, partial_name
from dissectors.errors import SourceError, UsageError

__all__ = ["Format"]

PARTITIONS = "partitions"
NO_DATE = "unknown"
"""The date of rows without one.

Hive's own name for it (`__HIVE_DEFAULT_PARTITION__`) is not used: pyarrow refuses a dataset with
such a partition, be it the only one or one of several.
"""

PATH_COLUMN = "bus"
"""The column of the tables that is in the path of a partition."""


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
        keys = _file_columns(options)
        self._new_file: Callable[[], _modlens.RowFile] = lambda: row_file(
            self.name, options.table, keys
        )
        self._file: _modlens.RowFile | None = None
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
        return self._only_file().rows(table)

    def footer(self) -> bytes:
        """The last row group and the footer of the file."""
        return b"" if self._folder is not None else self._only_file().end()

    def _only_file(self) -> _modlens.RowFile:
        """The file; a folder does not need it, whose files are made one by one."""
        if self._file is None:
            self._file = self._new_file()
        return self._file


def _file_columns(options: exports.ExportOptions) -> Sequence[str]:
    """The columns inside the files; `UsageError` where partitions would leave none of them."""
    if options.style != PARTITIONS:
        return options.columns
    keys = [key for key in options.columns if key != PATH_COLUMN]
    if not keys:
        raise UsageError(f"--columns {PATH_COLUMN}: it is in the path of each file; add another")
    return keys


class _PartitionedOutput:
    """A folder with a file for each day and bus, in subfolders `date=.../bus=...`.

    It is made under a temporary name and renamed when it is complete.
    """

    remark = ""

    def __init__(self, path: str, new_file: Callable[[], _modlens.RowFile]) -> None:
        self.name = path
        self._new_file = new_file
        self._files: dict[str, tuple[_modlens.RowFile, AtomicFile]] = {}
        folder, base = os.path.split(os.path.abspath(path))
        self._temporary_path: str | None = os.path.join(folder, f".{base}.{os.getpid()}")
        try:
            if os.path.lexists(path):
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
            os.mkdir(self._temporary_path)
        except OSError as error:
            self._temporary_path = None
            raise SourceError(
                f"{path}: no new folder can be created there: {error.strerror}"
            ) from error

    def write(self, table: _modlens.Table) -> None:
        """Write each row to the file of its day and bus."""
        if self._temporary_path is None:
            return
        for date, bus, rows in table.partitions():
            folder = os.path.join(f"date={date or NO_DATE}", f"bus={quote(bus, safe='')}")
            if folder not in self._files:
                parent = os.path.join(self._temporary_path, folder)
                try:
                    os.makedirs(parent, exist_ok=True)
                except OSError as error:
                    message = f"{self.name}: cannot be written: {error.strerror}"
                    raise SourceError(message) from error
                file = AtomicFile(os.path.join(parent, "part-0.parquet"))
                self._files[folder] = (self._new_file(), file)
            row_file, output = self._files[folder]
            output.append(row_file.rows(rows))

    def append(self, data: bytes) -> None:
        """Nothing to do: the rows are written by `write`."""

    def close(self, *, interrupted: bool = False) -> None:
        """Complete all files, and rename the folder."""
        if self._temporary_path is None:
            return
        for row_file, output in self._files.values():
            output.append(row_file.end())
            output.close()
        if interrupted:
            self.name = partial_name(self.name)
        complete = self._temporary_path
        try:
            os.rename(complete, self.name)
        except OSError as error:
            # What was decoded is worth more than a tidy folder, so it stays where it is.
            message = (
                f"{self.name}: cannot be created: {error.strerror}; the files are in {complete}"
            )
            raise SourceError(message) from error
        finally:
            self._temporary_path = None

    def rollback(self) -> None:
        """Delete the incomplete folder."""
        folder, self._temporary_path = self._temporary_path, None
        if folder is not None:
            for _, output in self._files.values():
                output.rollback()
            shutil.rmtree(folder, ignore_errors=True)
