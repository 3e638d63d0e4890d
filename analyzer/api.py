"""The public API: `decode` for recordings, `tap` for serial lines. Use it from `analyzer`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from types import TracebackType
from typing import Any, Literal, Self

import _modlens
from analyzer.columns import columns
from analyzer.filters import Filter, parse
from analyzer.line import Line, parse_line
from analyzer.live_run import LiveRun
from analyzer.profiles import Binding, parse_binding, with_vendor_functions
from analyzer.session import FileRun, Settings
from analyzer.silence_limits import silence_limits
from analyzer.times import utc_offset_changes
from dissectors.errors import UsageError

__all__ = ["Decoding", "Rows", "Tap", "decode", "tap"]

LAST_PORT = 65535

Path = str | os.PathLike[str]


class Rows:
    """The rows of one table of a recording.

    Every use reads the recording anew, and streams: memory stays flat.

    Iterate it for `Row` objects (an attribute per column, None where empty), or hand it to what
    takes an Arrow stream. `name` is the table's name.

    >>> rows = decode("bus.hex").frames.where("verdict != 'ok'")
    >>> rows.name, rows.columns[:2]
    ('frames', ('frame', 'time'))
    """

    def __init__(self, recording: Decoding, name: str, filters: tuple[Filter, ...] = ()) -> None:
        self.name = name
        self._recording = recording
        self._filters = filters

    @property
    def columns(self) -> tuple[str, ...]:
        """The keys of the columns, in order."""
        return tuple(column.key for column in columns(self.name))

    def where(self, text: str) -> Rows:
        """The rows that match a filter (see `analyzer.filters`).

        `FilterError` if it cannot be understood.
        """
        return Rows(self._recording, self.name, (*self._filters, parse(text, self.name)))

    def tables(self) -> Iterator[_modlens.Table]:
        """The rows in batches, as they are decoded.

        `SourceError` if the recording cannot be read.
        """
        predicates = [one.predicate() for one in self._filters]
        for batch in self._recording.batches(self.name):
            table: _modlens.Table = getattr(batch, self.name)
            for predicate in predicates:
                table = table.where(predicate)
            if len(table):
                yield table

    def __iter__(self) -> Iterator[_modlens.Row]:
        for table in self.tables():
            yield from table

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """An Arrow C stream over a new pass of the recording (the Arrow PyCapsule interface)."""
        stream = _modlens.ArrowStream(self.name, self.tables())
        return stream.__arrow_c_stream__(requested_schema)


class Decoding:
    """One or more recordings, decoded anew each time they are iterated; made by `decode`.

    Iterating it gives the transactions.
    """

    def __init__(self, names: tuple[str, ...], settings: Settings, read_as: str | None) -> None:
        self._names = names
        self._settings = settings
        self._read_as = read_as

    @property
    def transactions(self) -> Rows:
        """Requests with their responses, in request order."""
        return Rows(self, "transactions")

    @property
    def frames(self) -> Rows:
        """Every byte that was recorded, noise included, frame by frame."""
        return Rows(self, "frames")

    @property
    def readings(self) -> Rows:
        """Every register or bit that was read or written, a row each."""
        return Rows(self, "readings")

    @property
    def findings(self) -> Rows:
        """The findings: what is wrong or unusual, and what to check."""
        return Rows(self, "findings")

    def __iter__(self) -> Iterator[_modlens.Row]:
        return iter(self.transactions)

    def batches(self, *tables: str) -> Iterator[_modlens.Batch]:
        """One pass over the recordings; tables that are not named may be empty in the batches."""
        yield from self._run(tables).batches()

    def stats(self) -> dict[str, Any]:
        """Statistics of a whole pass; `analyzer.views.stats` documents the keys."""
        run = self._run(())
        for _ in run.batches():
            pass
        return run.stats()

    def _run(self, tables: Iterable[str]) -> FileRun:
        settings = replace(self._settings, tables=tuple(tables))
        return FileRun(self._names, settings, read_as=self._read_as)


def decode(  # noqa: PLR0913 - that many things can be said of a recording
    recordings: Path | Iterable[Path],
    *,
    line: str | Line | None = None,
    mode: str = "auto",
    read_as: str | None = None,
    timeout: float | None = None,
    functions: _modlens.Functions | None = None,
    profiles: Iterable[str | Binding] = (),
    dialects: _modlens.Dialects | None = None,
    timezone: str | None = None,
    date: str | None = None,
    ports: Iterable[int] | Literal["any"] | None = None,
    channels: Iterable[str] | None = None,
    segmentation: str = "joint",
    t35: str | None = None,
    t15: str | None = None,
) -> Decoding:
    """Decode one recording, or several one after the other.

    - `line`: the line settings, as `19200-8E1`; without them times are those of the reads
    - `mode`: `auto`, `rtu`, `ascii` or `tcp`
    - `read_as`: the format of the files, detected by default (`modlens formats` lists them)
    - `timeout`: seconds after which a request is given up; learned by default
    - `functions`: a table of functions with further rows
    - `profiles`: device profiles, each as `--profile` takes it (`1=mightyzap`, `2-7=pump.yaml`)
    - `dialects`: a table of text formats with further rows
    - `segmentation`: `joint` goes by all evidence; `silence` by silences of `t35` only, with those
      above `t15` inside a frame as findings, both as `1750us` or `3.5chars`; the specification's
      for `line` by default
    - `timezone`, `date`: of times in text that come without (see
      `analyzer.times.utc_offset_changes`)
    - `ports`: TCP and UDP ports of Modbus in captures, 502 by default; `any` looks everywhere
    - `channels`: those of a logic analyser, as `["RX", "TX"]`, found by default; `!RX` idles low

    `UsageError` for settings that cannot be. Nothing is read yet: `SourceError` comes when somebody
    looks.
    """
    names = (recordings,) if isinstance(recordings, str | os.PathLike) else tuple(recordings)
    if not names:
        raise UsageError("no recording to decode")
    settings = _settings(line, mode, timeout, functions, profiles)
    settings = replace(
        settings,
        silence_ns=silence_limits(segmentation, t35, t15, settings.line),
        dialects=dialects,
        zone=utc_offset_changes(timezone),
        date=date,
        ports=_ports(ports),
        channels=None if channels is None else tuple(channels),
    )
    return Decoding(tuple(os.fspath(name) for name in names), settings, read_as)


def _ports(ports: Iterable[int] | Literal["any"] | None) -> tuple[int, ...] | None:
    if ports is None or ports == "any":
        return None if ports is None else ()
    listed = tuple(ports)
    wrong = [port for port in listed if not 0 < port <= LAST_PORT]
    if wrong or not listed:
        raise UsageError(f"ports {list(listed)}: give numbers from 1 to {LAST_PORT}, or 'any'")
    return listed


class Tap:
    """A live tap; made by `tap`.

    Use it in `with`, and iterate it for transactions as they complete.
    """

    def __init__(self, run: LiveRun) -> None:
        self._run = run

    def __iter__(self) -> Iterator[_modlens.Row]:
        for batch in self.batches():
            yield from batch.transactions

    def batches(self) -> Iterator[_modlens.Batch]:
        """All decoded rows as batches, without end.

        A batch is given whenever rows are complete, and at least every 50 ms; it may be empty.
        """
        return self._run.batches()

    def stats(self) -> dict[str, Any]:
        """Statistics so far; `analyzer.views.stats` documents the keys."""
        return self._run.stats()

    def close(self) -> None:
        """Close the port."""
        self._run.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def tap(
    *ports: str,
    line: str | Line,
    mode: str = "auto",
    timeout: float | None = None,
    functions: _modlens.Functions | None = None,
    profiles: Iterable[str | Binding] = (),
) -> Tap:
    """Listen to a serial line; nothing is ever sent.

    `ports` are devices or URLs (`socket://host:port`, `rfc2217://host:port`): each is a bus, `A+B`
    is one bus of two lines. The other arguments are those of `decode`. `PortError` if a port cannot
    be opened, or later if it is lost.

        with tap("/dev/ttyUSB0", line="19200-8E1") as bus:
            for transaction in bus:
                print(transaction.unit, transaction.status)
    """
    if not ports:
        raise UsageError("no port to listen to")
    settings = _settings(line, mode, timeout, functions, profiles)
    return Tap(LiveRun(ports, settings, reconnect=False))


def _settings(
    line: str | Line | None,
    mode: str,
    timeout: float | None,
    functions: _modlens.Functions | None,
    profiles: Iterable[str | Binding],
) -> Settings:
    """The settings that `decode` and `tap` have in common."""
    bound = tuple(one if isinstance(one, Binding) else parse_binding(one) for one in profiles)
    return Settings(
        line=parse_line(line) if isinstance(line, str) else line,
        mode=mode,
        timeout_ns=None if timeout is None else round(timeout * 1e9),
        functions=with_vendor_functions(functions or _modlens.Functions(), bound),
        profiles=bound,
    )
