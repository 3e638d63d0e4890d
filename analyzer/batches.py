r"""Decoding inside an engine for large data: Arrow record batches in, those of a table out.

`decode_batches` is a plain function over iterators. It imports no engine; Spark, Ray and Dask call
it as it is (`docs/fleets.md`). Rows in are blocks of recordings, or bytes off lines:

| column | type | meaning |
| --- | --- | --- |
| `bus` | text, null | name of the bus; null names it after the recording |
| `path` | text, null | name of the recording that the block is of; null: bytes off the line |
| `offset` | int | position of the block in its recording, or in the stream of its line |
| `time` | timestamp or int (ns since 1970), null | when the bytes were read off the line |
| `bytes` | binary, null | the block; null: the file of that path, which is read here |
| `line` | text, null | optional: `A` or `B` of a bus with two lines |
| `size` | int, null | optional: bytes of the whole recording, which is decoded when all are there |

A block may begin and end anywhere. Those of a recording may come in any order, and it is decoded as
the file would be. Those of a line come in order of their offset; what comes twice counts once, and
a gap in the offsets is one in the stream. Numbers (`frame`, `txn` and those that refer to them)
begin with 1 in each recording and each bus: `running_numbers` makes them run on.

>>> import pyarrow
>>> blocks = {"bus": ["pumps"] * 2, "path": ["a.hex"] * 2, "offset": [10, 0]}
>>> blocks["bytes"] = [b"01840a\n0103020007f986\n", b"0103000000"]
>>> [batch] = decode_batches([pyarrow.record_batch(blocks)], BatchSettings())
>>> batch["bus"][0].as_py(), batch["status"][0].as_py(), batch["data"][0].as_py()
('pumps', 'ok', [7])
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import _modlens
from analyzer.columns import TABLES
from analyzer.installing import how_to_install
from analyzer.line import parse_line
from analyzer.profiles import parse_binding, with_vendor_functions
from analyzer.session import FileRun
from analyzer.settings import Settings
from analyzer.times import utc_offset_changes
from dissectors.errors import SourceError, UsageError

__all__ = ["BatchSettings", "decode_batches", "recording_of", "running_numbers", "schema"]

_NUMBERS = {
    "frames": ("frame", "request_frame", "response_frame"),
    "transactions": ("txn", "retry_of", "late_response_to"),
    "connections": ("connection",),
}
"""The table whose rows are numbered, and the columns of all tables with its numbers."""

_ROWS_AT_A_TIME = 50_000


@dataclass(frozen=True, slots=True)
class BatchSettings:
    """Holds what the decoder knows in advance; texts and numbers only, so that it can be sent.

    - `table`: the table of the rows out, one of `analyzer.columns.TABLES`
    - `line`, `mode`, `read_as`, `timeout`, `timezone`, `date`, `ports`: as for `modlens.decode`
    - `profiles`: as `--profile` takes them; a file has to be on every machine
    - `functions`: vendors by name, or the text of a table of functions

    `UsageError` for a table that is none.
    """

    table: str = TABLES[0]
    line: str | None = None
    mode: str = "auto"
    read_as: str | None = None
    timeout: float | None = None
    profiles: tuple[str, ...] = ()
    functions: tuple[str, ...] = ()
    timezone: str | None = None
    date: str | None = None
    ports: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if self.table not in TABLES:
            raise UsageError(f"no table {self.table!r}; it is one of {', '.join(TABLES)}")

    def decoder(self, bus: str | None) -> Settings:
        """The settings of the decoder for recordings of this bus."""
        functions = _modlens.Functions()
        for one in self.functions:
            if "\n" in one:
                functions.load(one, "functions")
            else:
                functions.load_vendor(one)
        bound = tuple(parse_binding(text) for text in self.profiles)
        return Settings(
            line=None if self.line is None else parse_line(self.line),
            mode=self.mode,
            timeout_ns=None if self.timeout is None else round(self.timeout * 1e9),
            functions=with_vendor_functions(functions, bound),
            tables=(self.table,),
            profiles=bound,
            ports=self.ports,
            zone=utc_offset_changes(self.timezone),
            date=self.date,
            bus_name=bus,
        )


def schema(table: str) -> Any:
    """The `pyarrow.Schema` of the rows of a table: the columns of `analyzer.columns`, in order."""
    return _pyarrow().RecordBatchReader.from_stream(_modlens.ArrowStream(table, iter(()))).schema


def decode_batches(
    batches: Iterable[Any],
    settings: BatchSettings | None = None,
    *,
    notify: Callable[[str], None] | None = None,
) -> Iterator[Any]:
    """Decode blocks of recordings and of lines; gives `pyarrow.RecordBatch`es of one table.

    `batches` are record batches of pyarrow or of any library whose batches can be handed over as
    Arrow, with the columns that the module lists. `notify` gets each recording that cannot be
    read or is damaged, which ends nothing: what could be read of it is decoded, and the others are.
    By default it is printed to standard error. `UsageError` for columns that are missing and blocks
    of a line out of order, or where pyarrow is not installed.
    """
    pieces = _Pieces(settings or BatchSettings(), notify or _print)
    for batch in batches:
        for row in _rows(batch):
            yield from pieces.take(row)
        yield from pieces.decided()
    yield from pieces.end()


@dataclass(frozen=True, slots=True)
class _Row:
    bus: str | None
    path: str | None
    offset: int
    time_ns: int | None
    data: bytes | None
    line: str | None
    size: int | None


class _Pieces:
    """What is waiting of recordings and lines."""

    def __init__(self, settings: BatchSettings, notify: Callable[[str], None]) -> None:
        self._settings = settings
        self._notify = notify
        self._recordings: dict[tuple[str | None, str], _Recording] = {}
        self._streams: dict[str, _Stream] = {}

    def take(self, row: _Row) -> Iterator[Any]:
        """The next block; gives the rows of a recording that is complete with it."""
        if row.path is None:
            bus = row.bus or "bus"
            if bus not in self._streams:
                self._streams[bus] = _Stream(bus, self._settings)
            self._streams[bus].take(row)
            return
        key = (row.bus, row.path)
        if row.data is None:
            yield from self._decode(*key, None)
            return
        recording = self._recordings.setdefault(key, _Recording({}))
        recording.pieces[row.offset] = row.data
        if row.size is not None and recording.held() >= row.size:
            yield from self._decode(*key, self._recordings.pop(key))

    def decided(self) -> Iterator[Any]:
        """The rows of lines that are decided by now."""
        for stream in self._streams.values():
            yield from _arrow(stream.core.take(), self._settings.table)

    def end(self) -> Iterator[Any]:
        """The rows that are left."""
        while self._recordings:
            key = next(iter(self._recordings))
            yield from self._decode(*key, self._recordings.pop(key))
        for stream in self._streams.values():
            stream.core.flush()
            yield from _arrow(stream.core.conclude(), self._settings.table)

    def _decode(self, bus: str | None, path: str, recording: _Recording | None) -> Iterator[Any]:
        """The rows of a recording; of the file of that name, block by block, where it is None."""
        try:
            run = FileRun(
                [path],
                self._settings.decoder(bus),
                read_as=self._settings.read_as,
                data={} if recording is None else {path: recording.joined(path)},
                on_status=lambda status: self._report(path, status.details.get("trouble")),
            )
            for batch in run.batches():
                yield from _arrow(batch, self._settings.table)
        except SourceError as error:
            self._notify(error.message)

    def _report(self, path: str, trouble: str | None) -> None:
        if trouble is not None:
            self._notify(f"{path}: {trouble}")


@dataclass(slots=True)
class _Recording:
    """Blocks of a recording by their offsets."""

    pieces: dict[int, bytes]
    end: int = 0

    def held(self) -> int:
        """The bytes that have come, up to the first gap."""
        while self.pieces.get(self.end):
            self.end += len(self.pieces[self.end])
        return self.end

    def joined(self, path: str) -> bytes:
        """The bytes; `SourceError` where some are missing."""
        at, parts = 0, []
        for offset, data in sorted(self.pieces.items()):
            if offset > at:
                raise SourceError(f"{path}: bytes {at} to {offset} have not come; not decoded")
            parts.append(data[at - offset :])
            at = max(at, offset + len(data))
        return b"".join(parts)


class _Stream:
    """A bus whose bytes come as they were read off its lines."""

    def __init__(self, bus: str, settings: BatchSettings) -> None:
        chosen = settings.decoder(None)
        self._bus = bus
        self.core = chosen.core(live=False)
        self._number: int | None = None
        self._chosen = chosen
        self._ends: dict[str | None, int] = {}
        self._gaps: dict[str | None, list[tuple[int, int]]] = {}

    def take(self, row: _Row) -> None:
        """The next bytes of a line."""
        data = row.data or b""
        if self._number is None:
            clock = "none" if row.time_ns is None else "utc"
            self._number = self._chosen.add_bus(self.core, self._bus, clock=clock)
        if row.line not in self._ends:
            self._ends[row.line], self._gaps[row.line] = row.offset, [(0, row.offset)]
            self.core.begin_at(self._number, row.offset, line=row.line)
        end, gaps = self._ends[row.line], self._gaps[row.line]
        stop = row.offset + len(data)
        if any(row.offset < behind and first < stop for first, behind in gaps):
            raise UsageError(
                f"bus {self._bus}: bytes at {row.offset} come after those up to {end}; sort the"
                " blocks of a bus by offset"
            )
        if row.offset > end:
            gaps.append((end, row.offset))
        if stop > end:
            hole = row.offset > end
            data = data[max(end - row.offset, 0) :]
            self.core.feed(self._number, data, row.time_ns, line=row.line, hole=hole)
            self._ends[row.line] = stop


def _rows(batch: Any) -> Iterator[_Row]:
    """The rows of a record batch; one is in memory as Python objects at a time."""
    arrow = _pyarrow()
    batch = arrow.record_batch(batch)
    names = batch.schema.names
    missing = [name for name in ("offset", "bytes") if name not in names]
    if missing or not {"bus", "path"} & set(names):
        raise UsageError(
            f"the batches have {', '.join(names)}; needed are bus or path, offset, bytes"
        )

    def column(name: str) -> Any:
        return batch.column(name) if name in names else [None] * batch.num_rows

    cells = [column(name) for name in ("bus", "path", "offset", "bytes", "line", "size")]
    for *found, time in zip(*cells, _times(column("time")), strict=True):
        bus, path, offset, data, line, size = (_value(cell) for cell in found)
        yield _Row(bus, path, offset or 0, _value(time), data, line, size)


def _value(cell: Any) -> Any:
    return None if cell is None else cell.as_py()


def _times(column: Any) -> Any:
    """Times as whole nanoseconds since 1970; without a zone they are UTC."""
    arrow = _pyarrow()
    if isinstance(column, list) or not arrow.types.is_timestamp(column.type):
        return column
    return column.cast(arrow.timestamp("ns", column.type.tz)).cast(arrow.int64())


def _arrow(batch: _modlens.Batch, name: str) -> Iterator[Any]:
    """The rows of a table as record batches; none where there are no rows."""
    table: _modlens.Table = getattr(batch, name)
    for start in range(0, len(table), _ROWS_AT_A_TIME):
        yield _pyarrow().record_batch(table.slice(start, _ROWS_AT_A_TIME))


def running_numbers(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The `pyarrow.Table`s with numbers that run on from one recording to the next.

    `tables` are those of one decoding by their names, `frames` and `transactions` among them: how
    many rows these have says where the next recording begins; without `connections` the numbers of
    those stay. Recordings are in the order of their names, as a directory has them on the command
    line; rows stay where they are. `UsageError` without the two, or for a table whose rows do not
    name their source.
    """
    if not {"frames", "transactions"} <= tables.keys():
        raise UsageError("running numbers need the tables frames and transactions")
    found = dict(tables)
    for counted, columns in _NUMBERS.items():
        if counted not in tables:
            continue
        first = _first_numbers(tables[counted])
        for name, table in found.items():
            found[name] = _shifted(name, table, columns, first)
    return found


def _first_numbers(table: Any) -> dict[str, int]:
    """How many rows of a table there are in front of each recording."""
    counts: dict[str, int] = {}
    for source in table.column("source").to_pylist():
        recording = recording_of(source)
        counts[recording] = counts.get(recording, 0) + 1
    first, before = {}, 0
    for recording in sorted(counts):
        first[recording] = before
        before += counts[recording]
    return first


def _shifted(name: str, table: Any, columns: tuple[str, ...], first: Mapping[str, int]) -> Any:
    arrow = _pyarrow()
    present = [name for name in columns if name in table.schema.names]
    if "source" not in table.schema.names:
        raise UsageError(f"{name} has no column source, which names the recording of a row")
    shift = [first.get(recording_of(source), 0) for source in table.column("source").to_pylist()]
    for column in present:
        at = table.schema.get_field_index(column)
        sums = arrow.compute.add(table.column(at), arrow.array(shift, arrow.int64()))
        table = table.set_column(at, table.schema.field(at), sums)
    return table


def recording_of(source: str) -> str:
    """The recording that a value of the column `source` names.

    >>> recording_of("a/pumps.log:12"), recording_of("b.bin@4096"), recording_of("c.pcap#7")
    ('a/pumps.log', 'b.bin', 'c.pcap')
    """
    return re.sub(r"[:#@]\d+(-\d+)?$", "", source)


def _pyarrow() -> Any:
    try:
        import pyarrow.compute  # noqa: PLC0415 - half a second, for those who use it
    except ImportError as error:
        raise UsageError(f"decode_batches needs a package: {how_to_install('pyarrow')}") from error
    return pyarrow


def _print(text: str) -> None:
    sys.stderr.write(f"modlens: {text}\n")
