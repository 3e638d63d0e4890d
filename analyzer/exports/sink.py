"""Exports while a run goes on: which rows of which table go to which output and format."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from analyzer.columns import TABLES, pick
from analyzer.exports import ExportOptions, Format, MultiTableFormat, format_of, load
from analyzer.exports.empty_columns import EmptyColumns
from analyzer.exports.output import Output, append_pieces
from dissectors.errors import UsageError

if TYPE_CHECKING:
    import _modlens

__all__ = [
    "ExportSink",
    "Target",
    "check_style",
    "parse_target",
    "required_tables",
    "with_suitable_table",
]


@dataclass(frozen=True, slots=True)
class Target:
    """The target of one export.

    A table, a format (a key of `analyzer.exports.FORMATS`), and a path (None for standard output).
    """

    table: str
    format: str
    path: str | None


def parse_target(text: str, table: str) -> Target:
    """Parse a value of `-o` such as `log.csv` or `frames:log.csv`.

    `table` is used where the text names none. If the format can hold only one table and the text
    names none, that one is used. `UsageError` if the format cannot hold the table.

    >>> parse_target("frames:f.csv", "transactions")
    Target(table='frames', format='csv', path='f.csv')
    >>> parse_target("bus.simulator.json", "transactions").table
    'readings'
    """
    head, colon, rest = text.partition(":")
    if colon and head == "events":
        raise UsageError(f"-o {text}: events are those of a live line; use modlens tap")
    if colon and head in TABLES:
        return with_suitable_table(Target(head, format_of(rest), rest), named=True)
    return with_suitable_table(Target(table, format_of(text), text), named=False)


def with_suitable_table(target: Target, *, named: bool) -> Target:
    """The target with a table that its format can hold.

    `named` is True where the user has named the table. `UsageError` if that does not fit, or there
    are several others.
    """
    holds = load(target.format).tables
    if target.table in holds:
        return target
    if named or len(holds) > 1:
        where = f"-o {target.path}" if target.path else f"--to {target.format}"
        choices = " or ".join(holds)
        raise UsageError(f"{where}: {target.format} holds {choices}, not {target.table}")
    return replace(target, table=holds[0])


def required_tables(targets: Iterable[Target]) -> set[str]:
    """The tables that have to be decoded for these targets."""
    found = set()
    for one in targets:
        format_class = load(one.format)
        found |= (
            set(format_class.required_tables)
            if issubclass(format_class, MultiTableFormat)
            else {one.table}
        )
    return found


def check_style(style: str | None, targets: Iterable[Target]) -> None:
    """Raise `UsageError` for a style that no target has."""
    known = {word for one in targets for word in load(one.format).styles}
    if style is not None and style not in known:
        there = (
            f"choose from {', '.join(sorted(known))}"
            if known
            else "none of these outputs has styles"
        )
        raise UsageError(f"--style {style}: {there}")


def _predicate(where: str, table: str) -> _modlens.Predicate:
    from analyzer.filters import parse  # noqa: PLC0415 - the language of filters is rarely spoken

    return parse(where, table).predicate()


class ExportSink:
    """A sink that writes the rows of one table to one output (see `analyzer.pump.Sink`).

    `columns` is the text of `--columns`, `where` that of `--where`; both must fit the table
    (`UsageError`, `FilterError`). With `growing` the file grows in place and must be new. `options`
    are further options; table, columns and `live` are overridden by the other arguments. At most
    `limit` rows are written.
    """

    def __init__(  # noqa: PLR0913 - what can be said of an export, all but the target by keyword
        self,
        target: Target,
        *,
        columns: str | None,
        where: str | None,
        growing: bool,
        options: ExportOptions | None = None,
        limit: int | None = None,
    ) -> None:
        format_class = load(target.format)
        if columns is not None and not format_class.has_column_choice:
            raise UsageError(f"--columns: {target.format} has columns of its own")
        self.table = target.table
        self.row_count = 0
        self.limit = limit
        keys = pick(target.table, columns)
        options = replace(
            options or ExportOptions("", ()), table=target.table, columns=keys, live=growing
        )
        if options.style not in format_class.styles:
            options = replace(options, style="")
        self._format: Format = format_class(options)
        self._predicate = None if where is None else _predicate(where, target.table)
        self._empty_columns = EmptyColumns(target.table, () if columns is None else keys)
        self._output: Output = self._format.output(target.path, growing=growing)
        self.name = self._output.name

    @property
    def any_thread(self) -> bool:
        """Whether `put` may be called in another thread than that which opens and closes."""
        return self._format.any_thread

    @property
    def is_full(self) -> bool:
        """Whether `limit` rows have been written."""
        return self.row_count == self.limit

    def put(self, batch: _modlens.Batch) -> None:
        """Write the rows of a batch."""
        table: _modlens.Table = getattr(batch, self.table)
        self.put_rows(batch, None if self._predicate is None else table.where(self._predicate))

    def begin(self, batch: _modlens.Batch) -> Callable[[], Callable[[], None]]:
        """Take a batch in two steps, for several threads; called in the order of batches.

        What it gives encodes the rows, in any thread, and gives what writes them. That has to be
        called in the order of batches, one at a time.
        """
        encode = self._format.encoder() if self.limit is None else None
        if encode is None:
            return lambda: partial(self.put, batch)
        return partial(self._encode, batch, encode)

    def _encode(
        self, batch: _modlens.Batch, encode: Callable[[_modlens.Table], Iterable[bytes]]
    ) -> Callable[[], None]:
        rows: _modlens.Table = getattr(batch, self.table)
        if self._predicate is not None:
            rows = rows.where(self._predicate)
        pieces, seen = tuple(encode(rows)), self._empty_columns.seen(rows)
        return partial(self._write, pieces, len(rows), seen)

    def _write(self, pieces: Iterable[bytes], row_count: int, seen: Container[str]) -> None:
        append_pieces(self._output, pieces)
        self.row_count += row_count
        self._empty_columns.drop(seen)

    def put_rows(self, batch: _modlens.Batch, kept: _modlens.Table | None) -> None:
        """Write some rows of a batch, as many as `limit` leaves; None is all rows of its table."""
        rows: _modlens.Table = getattr(batch, self.table) if kept is None else kept
        if self.limit is not None:
            rows = kept = rows.slice(0, self.limit - self.row_count)
        if isinstance(self._format, MultiTableFormat):
            pieces = self._format.encode_batch(batch, kept)
        else:
            pieces = self._format.encode_blocks(rows)
        self._write(pieces, len(rows), self._empty_columns.seen(rows))

    def close(self, *, interrupted: bool = False) -> None:
        """Complete the output; see `Output.close` for one that was `interrupted`."""
        data = self._format.footer()
        if data:
            self._output.append(data)
        self._output.close(interrupted=interrupted)
        self.name = self._output.name

    def closing_remark(self) -> str:
        """A remark for the user about the complete output; mostly empty."""
        return self._format.closing_remark() or self._output.remark

    def empty_columns(self) -> Sequence[str]:
        """A remark for each column of `--columns` that was empty in all rows."""
        return self._empty_columns.remarks(self.row_count)

    def rollback(self) -> None:
        """Discard the output because the input failed."""
        self._output.rollback()
