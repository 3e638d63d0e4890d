"""One export under way: which rows of which table go to which output in which format."""

from __future__ import annotations

from dataclasses import dataclass

import _modlens
from analyzer.columns import TABLES, pick
from analyzer.exports import format_of, load
from analyzer.exports.output import GrowingFile, Output, StandardOutput, WholeFile
from analyzer.filters import Filter, parse

__all__ = ["ExportSink", "Target", "target"]


@dataclass(frozen=True, slots=True)
class Target:
    """What `-o` asks for.

    A table, a format (a key of `analyzer.exports.FORMATS`), a path (None: standard output).
    """

    table: str
    format: str
    path: str | None


def target(text: str, table: str) -> Target:
    """The target that `log.csv` or `frames:log.csv` says.

    `table` is the one meant where none is named.

    >>> target("frames:f.csv", "transactions")
    Target(table='frames', format='csv', path='f.csv')
    """
    head, colon, rest = text.partition(":")
    if colon and head in TABLES:
        table, text = head, rest
    return Target(table, format_of(text), text)


class ExportSink:
    """Writes the rows of one table; see `analyzer.session.Sink`.

    `columns` is the text of `--columns`, `where` that of `--where`; both must fit the table
    (`UsageError`, `FilterError`). With `growing` the file grows in place and must be new.
    """

    def __init__(
        self, target: Target, *, columns: str | None, where: str | None, growing: bool
    ) -> None:
        self.table = target.table
        self.rows = 0
        self._format = load(target.format)(pick(target.table, columns))
        wanted: Filter | None = None if where is None else parse(where, target.table)
        self._predicate = None if wanted is None else wanted.predicate()
        self._output = _output(target.path, growing=growing)
        self.name = self._output.name

    def put(self, batch: _modlens.Batch) -> None:
        """Write the batch's rows."""
        table: _modlens.Table = getattr(batch, self.table)
        if self._predicate is not None:
            table = table.where(self._predicate)
        self.rows += len(table)
        data = self._format.rows(table)
        if data:
            self._output.append(data)

    def close(self) -> None:
        """All rows are there."""
        self._output.close()

    def abandon(self) -> None:
        """The input failed: leave nothing half written."""
        self._output.abandon()


def _output(path: str | None, *, growing: bool) -> Output:
    if path is None:
        return StandardOutput()
    return GrowingFile(path) if growing else WholeFile(path)
