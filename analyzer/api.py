"""The public API: `decode` for recordings, `tap` for serial lines. Use it from `analyzer`."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, BinaryIO, Literal, Never, NoReturn, Self, cast

import _modlens
from analyzer.columns import TABLES, columns
from analyzer.data_frames import LEAST_REQUESTS, outages, response_times
from analyzer.exports import format_of
from analyzer.exports.sink import Target, with_suitable_table
from analyzer.filters import selection
from analyzer.keywords import OF_FRAMES, OF_RECORDINGS, check_filter, refuse
from analyzer.line import Line, parse_line
from analyzer.live_run import LiveRun
from analyzer.notes import Notes
from analyzer.profiles import Binding, parse_binding, with_vendor_functions
from analyzer.row_types import (
    AnyRow,
    ConnectionRow,
    DiagnosisRow,
    FindingRow,
    FrameRow,
    ReadingRow,
    TransactionRow,
)
from analyzer.rows import Rows
from analyzer.session import FileRun
from analyzer.settings import Settings
from analyzer.silence_limits import silence_limits
from analyzer.times import utc_offset_changes
from dissectors.errors import SourceError, UsageError

__all__ = ["Decoding", "Rows", "Tap", "decode", "tap"]

LAST_PORT = 65535

Path = str | os.PathLike[str]

Source = Path | bytes | bytearray | memoryview | BinaryIO
"""A recording: the name of a file, bytes, or an open file."""

_BYTES = (bytes, bytearray, memoryview)
_ONE = (*_BYTES, str, os.PathLike)


class Decoding:
    """One or more recordings, decoded again each time they are iterated; made by `decode`.

    Iterating it gives the transactions.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        settings: Settings,
        read_as: str | None,
        data: Mapping[str, bytes] | None = None,
        chosen: str | None = None,
    ) -> None:
        self.names = names
        self._settings = settings
        self._read_as = read_as
        self._data = data or {}
        self._chosen = chosen
        self._notes: tuple[str, ...] | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What a pass has to say beside its rows, as the command does on standard error.

        What was skipped of captures and logs, and settings that can hardly be meant so. Where that
        is likely to cost rows, `ModlensWarning` says it as well. Those of the last whole pass; one
        is made where there was none.
        """
        if self._notes is None:
            self.stats()
        return self._notes or ()

    @property
    def transactions(self) -> Rows[TransactionRow]:
        """Requests with their responses, in request order."""
        return Rows(self, "transactions")

    @property
    def frames(self) -> Rows[FrameRow]:
        """Every byte that was recorded, noise included, frame by frame."""
        return Rows(self, "frames")

    @property
    def readings(self) -> Rows[ReadingRow]:
        """Every register or bit that was read or written, a row each."""
        return Rows(self, "readings")

    @property
    def findings(self) -> Rows[FindingRow]:
        """The findings: what is wrong or unusual, and what to check."""
        return Rows(self, "findings")

    @property
    def connections(self) -> Rows[ConnectionRow]:
        """The TCP connections of captures, in the order in which they begin."""
        return Rows(self, "connections")

    @property
    def diagnoses(self) -> Rows[DiagnosisRow]:
        """The causes that `modlens doctor` reports: a row each, at the end of a pass."""
        return Rows(self, "diagnoses")

    def where(self, text: str = "", **columns: Never) -> Decoding:
        """The same recording as if nothing else had happened: for `stats`, `doctor` and the rows.

        The filter chooses transactions; their frames and findings come with them, and rows without
        a transaction where they meet it themselves. `FilterError` if it cannot be understood.

        >>> from modlens import decode
        >>> decode(bytes.fromhex("1103006B00037687 110306022B00000064C8BA")).where("unit == 17")
        <recording memory-1 where unit == 17>
        """
        check_filter(text, columns)
        chosen = text if self._chosen is None else f"({self._chosen}) and ({text})"
        settings = replace(self._settings, select=selection(lambda _: chosen))
        return Decoding(self.names, settings, self._read_as, self._data, chosen)

    def table(self, name: str) -> Rows[AnyRow]:
        """The rows of a table by its name; `UsageError` if there is no such table."""
        columns(name)
        return Rows(self, name)

    def write(self, path: Path, *, style: str | None = None) -> int:
        """Write a file in the format of its ending: transactions, where it can hold them.

        Gives the number of rows; see `Rows.write`, which writes other tables and parts of them.
        """
        name = os.fspath(path)
        target = with_suitable_table(Target("transactions", format_of(name), name), named=False)
        return self.table(target.table).write(path, style=style)

    def __iter__(self) -> Iterator[TransactionRow]:
        return iter(self.transactions)

    def __getattr__(self, name: str) -> NoReturn:
        """What rows or a DataFrame have: `AttributeError` says what to write."""
        call = "()" if callable(getattr(Rows, name, None)) else ""
        rows = "readings" if name == "wide" else "transactions"
        instead = f"; write recording.{rows}.{name}{call}" if hasattr(Rows, name) else ""
        if name in OF_FRAMES:
            instead = f"; write recording.transactions.{OF_FRAMES[name]}"
        elif name in OF_RECORDINGS:
            instead = f"; write recording.{OF_RECORDINGS[name]}"
        raise AttributeError(f"a recording has no {name!r}{instead}")

    def __getitem__(self, place: object, /) -> NoReturn:
        """Raise `UsageError`: a recording has several tables."""
        rows = place if isinstance(place, str) and place in TABLES else "transactions"
        instead = "" if place == rows else f"[{place!r}]"
        raise UsageError(f"a recording has tables: write recording.{rows}{instead}")

    def __repr__(self) -> str:
        chosen = "" if self._chosen is None else f" where {self._chosen}"
        return f"<recording {', '.join(self.names)}{chosen}>"

    def batches(self, *tables: str) -> Iterator[_modlens.Batch]:
        """One pass over the recordings; tables that are not named may be empty in the batches."""
        yield from self._pass(self._run(tables, notes := Notes(self._notes or ())), notes)

    def stats(self) -> dict[str, Any]:
        """Statistics of a whole pass; the site's page "Statistics and verdict" lists the keys."""
        run = self._run((), notes := Notes(self._notes or ()))
        for _ in self._pass(run, notes):
            pass
        return run.stats()

    def doctor(self) -> dict[str, Any]:
        """The verdict, the diagnoses and the margins of a whole pass.

        The site's page "Statistics and verdict" lists the keys.
        """
        run = self._run(("diagnoses",), notes := Notes(self._notes or ()))
        for _ in self._pass(run, notes):
            pass
        return run.doctor()

    def show(
        self,
        txn: int | TransactionRow | FrameRow | None = None,
        *,
        frame: int | None = None,
        width: int = 100,
    ) -> str:
        """The bytes of a transaction or frame beside their meaning, as `modlens show` prints them.

        A row may stand for its number.

        `UsageError` where there is none of this number.

        >>> from modlens import decode
        >>> print(decode(bytes.fromhex("1103006B00037687")).show(frame=1, width=70))
        frame 1: request, rtu, ok
        offset  bytes  field     value   meaning
             0  11     unit      17      unit 17
             1  03     function  3       Read Holding Registers, request
             2  00 6b  address   107     107 = 0x006B, 400108 (40108)
             4  00 03  quantity  3       3 registers, 400108 to 400110
             6  76 87  checksum  0x8776  CRC OK
        <BLANKLINE>
        """
        from analyzer.annotated import text_of  # noqa: PLC0415 - for those who look at bytes

        run = self._run(("transactions", "frames", "findings", "readings"), Notes())
        return text_of(run, self._settings.functions, txn=txn, frame=frame, width=width)

    def outages(self, *, requests: int = LEAST_REQUESTS) -> Any:
        """When units were away, as a `pandas.DataFrame`: at least so many `requests` unanswered.

        A row is a stretch in which every request to a unit was left unanswered: `bus`, `unit`,
        `begin` (the first such request), `end` (the next one with a response, empty where there is
        none), `duration`, `last_request`, `requests`. Without times in UTC, `begin` and `end` count
        from the start. `UsageError` where pandas or pyarrow is not installed, or `requests` is no
        whole number.
        """
        if not isinstance(requests, int):
            raise UsageError(f"requests is a number such as {LEAST_REQUESTS}, not {requests!r}")
        return outages(self.transactions, requests)

    def response_times(self, by: str | Sequence[str] = "unit", *, every: str | None = None) -> Any:
        """How fast requests were answered, as a `pandas.DataFrame`: count, p50, p95 and maximum.

        `answered` counts the requests that had an answer, `count` those of them whose time is
        known: a time below twice the resolution of the recording's clock is not. `by` is a column
        of transactions, or several (`("unit", "function")`); with `every` ('1h', '15min') there is
        a row for each interval in which there were responses. Times are microseconds.
        `UsageError` where pandas or pyarrow is not installed.
        """
        return response_times(self.transactions, by, every)

    def _pass(self, run: FileRun, notes: Notes) -> Iterator[_modlens.Batch]:
        """The batches of a run; at its end its notes are those of the recording."""
        yield from run.batches()
        self._notes = tuple(notes)

    def _run(self, tables: Iterable[str], notes: Notes) -> FileRun:
        return FileRun(
            self.names,
            replace(self._settings, tables=tuple(tables)),
            read_as=self._read_as,
            data=self._data,
            notify=notes.add,
            on_status=notes.of_status,
        )


def decode(  # noqa: PLR0913 - that many things can be said of a recording
    recordings: Source | Iterable[Source],
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
    **other: Never,
) -> Decoding:
    """Decode one recording, or several one after the other.

    A recording is a file's name, its bytes, or an open binary file, which is read to its end here.

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
    - `channels`: those of a logic analyzer, as `["RX", "TX"]`, found by default; `!RX` idles low

    `UsageError` for settings that cannot be, `SourceError` for a file that does not exist. Files
    are read when rows are asked for.
    """
    refuse(decode, other)
    names, data = _sources(recordings)
    if isinstance(channels, str):
        raise UsageError(f'channels is a list such as ["RX", "TX"], not {channels!r}')
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
    return Decoding(names, settings, read_as, data)


def _sources(recordings: Source | Iterable[Source]) -> tuple[tuple[str, ...], dict[str, bytes]]:
    """The names of the recordings, and the bytes of those that are not files of that name."""
    several = isinstance(recordings, Iterable) and not isinstance(recordings, _ONE)
    several = several and not hasattr(recordings, "read")
    names: list[str] = []
    data: dict[str, bytes] = {}
    for source in cast(Iterable[Source], recordings if several else (recordings,)):
        if isinstance(source, str | os.PathLike):
            names.append(_existing(os.fspath(source)))
            continue
        if not isinstance(source, _BYTES) and not hasattr(source, "read"):
            kind = type(source).__name__
            raise UsageError(f"a recording is a file's name, bytes or an open file, not {kind}")
        label = getattr(source, "name", None)
        name = label if isinstance(label, str) else f"memory-{len(names) + 1}"
        data[name] = bytes(source) if isinstance(source, _BYTES) else source.read()
        names.append(name)
    if not names:
        raise UsageError("no recording to decode")
    return tuple(names), data


def _existing(name: str) -> str:
    """Returns the name of a file or folder, `-` for standard input; `SourceError` for others."""
    if name != "-" and not os.path.lexists(name):
        raise SourceError(f"{name}: no such file")
    return name


def _ports(ports: Iterable[int] | Literal["any"] | None) -> tuple[int, ...] | None:
    if ports is None or ports == "any":
        return None if ports is None else ()
    if not isinstance(ports, Iterable) or isinstance(ports, str):
        raise UsageError(f"ports is a list such as [502, 1502], or 'any', not {ports!r}")
    listed = tuple(ports)
    wrong = [port for port in listed if not 0 < port <= LAST_PORT]
    if wrong or not listed:
        raise UsageError(f"ports {list(listed)}: give numbers from 1 to {LAST_PORT}, or 'any'")
    return listed


class Tap:
    """A live tap; made by `tap`.

    Use it in `with`, and iterate it for transactions as they complete, with `for` or `async for`.
    Other threads may ask for `stats`, and `close` it, which ends the iteration.
    """

    def __init__(self, run: LiveRun) -> None:
        self._run = run

    def __iter__(self) -> Iterator[TransactionRow]:
        for batch in self.batches():
            yield from cast(Iterable[TransactionRow], batch.transactions)

    async def __aiter__(self) -> AsyncIterator[TransactionRow]:
        """The same for `async for`; waiting happens in another thread."""
        import asyncio  # noqa: PLC0415 - 30 ms, for those who use it already

        batches = self.batches()
        while (batch := await asyncio.to_thread(next, batches, None)) is not None:
            for row in cast(Iterable[TransactionRow], batch.transactions):
                yield row

    def batches(self) -> Iterator[_modlens.Batch]:
        """All decoded rows as batches, without end.

        A batch is given whenever rows are complete, and at least every 50 ms; it may be empty.
        """
        return self._run.batches()

    def stats(self) -> dict[str, Any]:
        """Statistics so far, with the keys of `Decoding.stats`."""
        return self._run.stats()

    def close(self) -> None:
        """Close the port."""
        self._run.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def tap(  # noqa: PLR0913 - all but the ports by keyword
    *ports: str,
    line: str | Line | None = None,
    mode: str = "auto",
    timeout: float | None = None,
    functions: _modlens.Functions | None = None,
    profiles: Iterable[str | Binding] = (),
    notify: Callable[[str], None] = lambda _: None,
    **other: Never,
) -> Tap:
    """Listen to a serial line; nothing is ever sent.

    `ports` are devices or URLs (`socket://host:port`, `rfc2217://host:port`): each is a bus, `A+B`
    is one bus of two lines. Without `line` the settings are found by listening, which needs some
    traffic; `notify` gets messages about that and about the ports. The other arguments are those of
    `decode`. `PortError` if a port cannot be opened, or later if it is lost.

        with tap("/dev/ttyUSB0", line="19200-8E1") as bus:
            for transaction in bus:
                print(transaction.unit, transaction.status)
    """
    refuse(tap, other)
    if not ports:
        raise UsageError("no port to listen to")
    if not all(isinstance(port, str) for port in ports):
        raise UsageError(f'a port is a text such as "/dev/ttyUSB0", not {ports[0]!r}')
    settings = _settings(line, mode, timeout, functions, profiles)
    return Tap(LiveRun(ports, settings, notify=notify, reconnect=False))


def _settings(
    line: str | Line | None,
    mode: str,
    timeout: float | None,
    functions: _modlens.Functions | None,
    profiles: Iterable[str | Binding],
) -> Settings:
    """The settings that `decode` and `tap` have in common."""
    if isinstance(profiles, str | Mapping):
        raise UsageError('profiles is a list such as ["1=mightyzap", "2-7=pump.yaml"]')
    if not isinstance(line, str | Line | None):
        raise UsageError(f'line is a text such as "19200-8E1" (rate, bits, parity), not {line!r}')
    profiles = tuple(profiles)
    if not all(isinstance(one, str | Binding) for one in profiles):
        raise UsageError('profiles is a list such as ["1=mightyzap", "2-7=pump.yaml"]')
    if not isinstance(timeout, int | float | None):
        raise UsageError(f"timeout is a number of seconds such as 0.5, not {timeout!r}")
    if isinstance(functions, str):
        raise UsageError(
            "functions is a table of functions, not a name; the command line has names"
        )
    bound = tuple(one if isinstance(one, Binding) else parse_binding(one) for one in profiles)
    return Settings(
        line=parse_line(line) if isinstance(line, str) else line,
        mode=mode,
        timeout_ns=None if timeout is None else round(timeout * 1e9),
        functions=with_vendor_functions(functions or _modlens.Functions(), bound),
        profiles=bound,
    )
