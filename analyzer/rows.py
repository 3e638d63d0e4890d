"""The rows of a table of a recording: filtered, cut, counted, shown, handed on, written.

Nothing is kept: each use decodes the recording again and streams, so that memory stays flat. Ask
for several things at once where that takes long (`to_polars`, `to_arrow` make one pass).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from html import escape
from itertools import islice
from typing import Any, Generic, Never, NoReturn, Protocol, TypeVar, overload

import _modlens
from analyzer.columns import columns, pick
from analyzer.data_frames import library, typed, wide
from analyzer.exports import ExportOptions, format_of
from analyzer.exports.sink import (
    ExportSink,
    Target,
    check_style,
    required_tables,
    with_suitable_table,
)
from analyzer.filters import Filter, parse
from analyzer.keywords import OF_FRAMES, check_filter, refuse
from analyzer.visible import visible
from dissectors.errors import ModlensError, UsageError

__all__ = ["Rows"]

HEAD_ROWS = 10
SHOWN_ROWS = 20
"""Rows that a notebook shows of a table."""

Item_co = TypeVar("Item_co", covariant=True)

Path = str | os.PathLike[str]


class Batches(Protocol):
    """What rows are read from: a recording that can be decoded again and again."""

    @property
    def names(self) -> Sequence[str]:
        """The names of its files."""

    def batches(self, *tables: str) -> Iterator[_modlens.Batch]:
        """One pass; tables that are not named may be empty in the batches."""


class Rows(Generic[Item_co]):
    """The rows of one table of a recording, or some of them.

    Iterate it for rows (an attribute per column, None where empty), or hand it to what takes an
    Arrow stream. `name` is the table's name.

    >>> from modlens import decode
    >>> rows = decode(b"").frames.where("verdict != 'ok'")
    >>> rows.name, rows.columns[:2]
    ('frames', ('frame', 'time'))
    """

    def __init__(
        self,
        recording: Batches,
        name: str,
        steps: tuple[Filter | slice, ...] = (),
        selected: tuple[str, ...] | None = None,
    ) -> None:
        self.name = name
        self._recording = recording
        self._steps = steps
        self._selected = selected

    @property
    def columns(self) -> tuple[str, ...]:
        """The keys of the columns, in order."""
        return self._selected or tuple(column.key for column in columns(self.name))

    def where(self, text: str = "", **columns: Never) -> Rows[Item_co]:
        """Returns the rows that match a filter (see `analyzer.filters`).

        `FilterError` if it cannot be understood.
        """
        check_filter(text, columns)
        return self._with(parse(text, self.name))

    def select(self, *keys: str) -> Rows[tuple[Any, ...]]:
        """These columns only; iterating gives tuples of their values.

        `UsageError` for a column that the table does not have.

        >>> from modlens import decode
        >>> decode(b"").transactions.select("unit", "status").columns
        ('unit', 'status')
        """
        if not all(isinstance(key, str) for key in keys):
            raise UsageError('write the columns one by one: select("unit", "status")')
        return Rows(self._recording, self.name, self._steps, pick(self.name, ",".join(keys)))

    def head(self, count: int = HEAD_ROWS) -> Rows[Item_co]:
        """The first rows."""
        return self[:count]

    def tables(self) -> Iterator[_modlens.Table]:
        """The rows in batches, as they are decoded; a selection of columns does not show in them.

        `SourceError` if the recording cannot be read.
        """
        for _, table in self._pass((self.name,)):
            if len(table):
                yield table

    def write(self, path: Path, *, style: str | None = None) -> int:
        """Write the rows to a file, in the format of its ending; gives the number of rows.

        `style` is a word of `--style`. A file of that name is replaced when the new one is
        complete. `UsageError` for an ending without a format, or one that cannot hold this table;
        `SourceError` if the file cannot be written.
        """
        name = os.fspath(path)
        target = with_suitable_table(Target(self.name, format_of(name), name), named=True)
        check_style(style, [target])
        sink = ExportSink(
            target,
            columns=None if self._selected is None else ",".join(self._selected),
            where=None,
            growing=False,
            options=ExportOptions("", (), style=style or "", buses=tuple(self._recording.names)),
        )
        try:
            for batch, table in self._pass(tuple(required_tables([target]))):
                sink.put_rows(batch, table if self._steps else None)
            sink.close()
        except BaseException:
            sink.rollback()
            raise
        return sink.row_count

    def to_arrow(self) -> Any:
        """A `pyarrow.Table`; `UsageError` where pyarrow is not installed."""
        return self._handed_to(library("pyarrow").table)

    def to_polars(self) -> Any:
        """A `polars.DataFrame`; `UsageError` where polars is not installed."""
        return self._handed_to(library("polars").DataFrame)

    def to_pandas(self, **unknown: Never) -> Any:
        """A `pandas.DataFrame`, by way of pyarrow; `UsageError` where one is not installed.

        Texts that come again (`status`, `function_name`) are categories, whole numbers and truth
        values may be missing (`Int64`, `boolean`), times are UTC to the nanosecond.
        """
        refuse(self.to_pandas, unknown)
        return typed(self.to_arrow())

    def wide(self, every: str | None = None, *, how: str = "last") -> Any:
        """Readings as a `pandas.DataFrame`: time down, a column for each named value.

        A register without a name is `unit 3 holding_register 107`; a name that several units have
        gets its unit in front, and with several recordings each gets its bus. With `every` ('10s',
        '15min', '1h') there is a row for each interval, with the `how` of its values: last, first,
        mean, min or max. Where nothing was read the cell stays empty: no value is carried on.
        `attrs["units"]` has the unit of measure of each column that a profile gives one.

        `UsageError` for rows of another table, or where pandas or pyarrow is not installed.
        """
        return wide(self, every, how)

    def __iter__(self) -> Iterator[Item_co]:
        item = self._item()
        for table in self.tables():
            for row in table:
                yield item(row)

    def dicts(self) -> Iterator[dict[str, Any]]:
        """Each row as a dict of its columns, those of `select` only; None where empty.

        >>> from modlens import decode
        >>> request, response = "1103006B00037687", "110306022B00000064C8BA"
        >>> both = bytes.fromhex(request + response)
        >>> next(decode(both).transactions.select("unit", "status").dicts())
        {'unit': 17, 'status': 'ok'}
        """
        keys = self.columns
        for table in self.tables():
            for row in table:
                yield {key: getattr(row, key) for key in keys}

    def __len__(self) -> int:
        return sum(len(table) for table in self.tables())

    @overload
    def __getitem__(self, place: int, /) -> Item_co: ...
    @overload
    def __getitem__(self, place: slice, /) -> Rows[Item_co]: ...
    def __getitem__(self, place: int | slice, /) -> Item_co | Rows[Item_co]:
        if isinstance(place, str):
            raise UsageError(f'rows have numbers; write select("{place}") for a column')
        if isinstance(place, bool) or not isinstance(place, int | slice):
            raise UsageError(
                'rows have numbers; write where("unit == 3") for some of them,'
                ' select("unit", "status") for columns'
            )
        if isinstance(place, slice):
            return self._with(self._forward(place))
        at = place if place >= 0 else len(self) + place
        for row in self[at : at + 1] if at >= 0 else ():
            return row
        raise IndexError(f"row {place} of {self.name}")

    def __getattr__(self, name: str) -> NoReturn:
        """A column, or what a DataFrame has: `AttributeError` says what to write."""
        instead = "" if name.startswith("_") else f"; {self._instead(name)}"
        raise AttributeError(f"{self.name} have no {name!r}{instead}")

    def _instead(self, name: str) -> str:
        """What to write for a name that rows do not have."""
        if callable(getattr(type(self._recording), name, None)):
            return f"write recording.{name}()"
        if name in OF_FRAMES:
            return f"write {OF_FRAMES[name]}"
        try:
            [key] = pick(self.name, name)
        except UsageError as error:
            return str(error).partition("; ")[2]
        return f'write select("{key}") for the column, where("{key} == ...") for rows'

    def __repr__(self) -> str:
        parts = [f"[{_bound(step.start)}:{_bound(step.stop)}]" if isinstance(step, slice)
                 else f" where {step}" for step in self._steps]  # fmt: skip
        return f"<{self.name} of {', '.join(self._recording.names)}{''.join(parts)}>"

    def _repr_html_(self) -> str:
        """The first rows as a table for a notebook, without the columns that are empty in them."""
        rows = list(islice((row for table in self.tables() for row in table), SHOWN_ROWS + 1))
        shown = rows[:SHOWN_ROWS]
        keys = self._selected or tuple(
            key for key in self.columns if any(getattr(row, key) not in (None, []) for row in shown)
        )
        head = "".join(f"<th>{escape(key)}</th>" for key in keys)
        lines = "".join(
            f"<tr>{''.join(f'<td>{_cell(getattr(row, key))}</td>' for key in keys)}</tr>"
            for row in shown
        )
        more = f"the first {SHOWN_ROWS} rows" if len(rows) > SHOWN_ROWS else "all rows"
        return (
            f"<table><caption>{escape(visible(repr(self)[1:-1]))}: {more}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"
        )

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """An Arrow C stream over a new pass of the recording (the Arrow PyCapsule interface)."""
        stream = _modlens.ArrowStream(self.name, self.tables(), self.columns)
        return stream.__arrow_c_stream__(requested_schema)

    def _handed_to(self, take: Callable[[object], Any]) -> Any:
        """What a library makes of the rows.

        An error of ours is raised as it is: libraries put their own around it.
        """
        errors: list[ModlensError] = []

        def tables() -> Iterator[_modlens.Table]:
            try:
                yield from self.tables()
            except ModlensError as error:
                errors.append(error)
                raise

        try:
            return take(_modlens.ArrowStream(self.name, tables(), self.columns))
        except Exception:
            if errors:
                raise errors[0] from None
            raise

    def _with(self, step: Filter | slice) -> Rows[Item_co]:
        return Rows(self._recording, self.name, (*self._steps, step), self._selected)

    def _forward(self, place: slice) -> slice:
        """The slice with its bounds counted from the first row, which may take a pass to count."""
        if place.step not in (None, 1):
            raise UsageError(f"rows are read in order: no step of {place.step}")
        bounds = (place.start, place.stop)
        if any(bound is not None and bound < 0 for bound in bounds):
            return slice(*place.indices(len(self))[:2])
        return place

    def _item(self) -> Callable[[Any], Any]:
        keys = self._selected
        return _same if keys is None else lambda row: tuple(getattr(row, key) for key in keys)

    def _pass(self, needed: Sequence[str]) -> Iterator[tuple[_modlens.Batch, _modlens.Table]]:
        """One pass over the recording: each batch with the rows of the table that are wanted."""
        cuts = [_Cut(step) if isinstance(step, slice) else _Sieve(step) for step in self._steps]
        for batch in self._recording.batches(*needed):
            table: _modlens.Table = getattr(batch, self.name)
            for cut in cuts:
                table = cut.take(table)
            yield batch, table
            if any(cut.is_done for cut in cuts):
                return


class _Sieve:
    """Keeps the rows that match a filter."""

    is_done = False

    def __init__(self, wanted: Filter) -> None:
        self._predicate = wanted.predicate()

    def take(self, table: _modlens.Table) -> _modlens.Table:
        """What is kept of further rows."""
        return table.where(self._predicate)


class _Cut:
    """Keeps the rows from one number on and before another."""

    def __init__(self, place: slice) -> None:
        self._skip = place.start or 0
        self._left = None if place.stop is None else max(place.stop - self._skip, 0)

    @property
    def is_done(self) -> bool:
        """Whether no further row will be kept."""
        return self._left == 0

    def take(self, table: _modlens.Table) -> _modlens.Table:
        """What is kept of further rows."""
        kept = table.slice(self._skip, len(table) if self._left is None else self._left)
        self._skip = max(self._skip - len(table), 0)
        if self._left is not None:
            self._left -= len(kept)
        return kept


def _same(row: Any) -> Any:
    return row


def _bound(number: int | None) -> str:
    return "" if number is None else str(number)


def _cell(value: object) -> str:
    """A value in a notebook: bytes as hex, nothing for None; no character may act as another."""
    if value is None:
        return ""
    return escape(visible(value.hex() if isinstance(value, bytes) else str(value)))
