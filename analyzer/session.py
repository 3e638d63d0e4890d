r"""From sources to sinks: feeds recordings to the core and passes its batches on.

A `FileRun` goes through recordings; `analyzer.live_run` has the run that listens to ports. Both
give batches one after the other, as they are decoded, so that memory does not grow with the input;
`pump` passes them to sinks. Nothing here looks at a frame.

>>> import tempfile, pathlib
>>> path = pathlib.Path(tempfile.mkdtemp()) / "bus.hex"
>>> _ = path.write_text("010300000001840a\n0103020007f986\n")
>>> run = FileRun([str(path)], Settings())
>>> [row.status for batch in run.batches() for row in batch.transactions]
['ok']
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import _modlens
from analyzer.line import Line
from analyzer.profiles import Binding
from analyzer.sources import FORMATS, is_binary
from analyzer.sources.files import RAW, Recording, check_readable
from analyzer.sources.pipes import STDIN, FirstBytes
from analyzer.sources.saleae import Levels
from analyzer.sources.sigrok import Samples
from analyzer.sources.unpack import Archives, RecordingName, expand
from dissectors.errors import CaptureError, SourceError, UsageError

__all__ = ["MODES", "FileRun", "PartialBatch", "RecordingStatus", "Run", "Settings", "Sink", "pump"]

MODES = ("auto", "rtu", "ascii", "tcp")

_IDLE_READS_TO_SETTLE = 5
"""Reads of a growing file without new data (half a second) after which its rows are decided."""

DEFAULT_TABLES = ("frames", "transactions", "findings")


@dataclass(frozen=True, slots=True)
class Settings:
    """What the decoder is told in advance.

    - `line`: the line settings, None where they are not known
    - `mode`: one of `MODES`
    - `timeout_ns`: after which a request is given up; None lets the core learn it
    - `functions`: the table of functions, vendors' rows included
    - `tables`: the tables worth building
    - `silence_ns`: t3.5 and t1.5, if frames end at silences only; None goes by all evidence
    - `profiles`: which units have which device profile
    - `channels`: those of a logic analyser; `!` before a name says that it idles low
    - `ports`: where a capture is searched for Modbus; None is 502, nothing in it is everywhere
    - `dialects`: the table of text formats, users' rows included; None for the embedded one
    - `zone`: of times without one: from which ns since 1970 on which offset in ns holds
    - `date`: the day of the first time without a date, as 2026-11-21
    """

    line: Line | None = None
    mode: str = "auto"
    timeout_ns: int | None = None
    functions: _modlens.Functions = field(default_factory=_modlens.Functions)
    tables: Sequence[str] = DEFAULT_TABLES
    profiles: Sequence[Binding] = ()
    silence_ns: tuple[int, int] | None = None
    ports: Sequence[int] | None = None
    channels: Sequence[str] | None = None
    dialects: _modlens.Dialects | None = None
    zone: Sequence[tuple[int, int]] = ()
    date: str | None = None

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise UsageError(f"mode {self.mode!r}; it is one of {', '.join(MODES)}")
        if self.timeout_ns is not None and self.timeout_ns <= 0:
            raise UsageError("the timeout must be longer than 0")

    def core(self, *, live: bool) -> _modlens.Session:
        """A new session of the core with these settings."""
        tables = self.tables
        if "readings" in tables and "transactions" not in tables:
            tables = (*tables, "transactions")
        core = _modlens.Session(
            self.functions, live=live, timeout_ns=self.timeout_ns, tables=tuple(tables)
        )
        for one in self.profiles:
            core.bind(one.profile.core, one.units, bus=one.bus)
        return core

    def add_bus(self, core: _modlens.Session, name: str, *, clock: str) -> int:
        """Add a bus of this name to the core; gives its number."""
        line = None if self.line is None else self.line.settings
        return core.add_bus(
            name,
            source=name,
            mode=self.mode,
            line=line,
            clock=clock,
            silence_ns=self.silence_ns,
        )

    def add_capture(self, core: _modlens.Session, name: str) -> int:
        """Add a capture of this name to the core; gives its number."""
        line = None if self.line is None else self.line.settings
        return core.add_capture(
            name, ports=self.ports, mode=self.mode, line=line, silence_ns=self.silence_ns
        )

    def add_logic(self, core: _modlens.Session, samples: Samples | Levels) -> int:
        """Add the samples of a logic analyser to the core; gives their number."""
        names = [name.removeprefix("!") for name in self.channels or ()]
        low = any(name.startswith("!") for name in self.channels or ())
        return core.add_logic(
            samples.name,
            rate=samples.rate,
            unit=samples.unit,
            channels=samples.channels(names) if names else None,
            inverted=True if low else None,
            mode=self.mode,
            line=None if self.line is None else self.line.settings,
        )


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """The status of a recording: how its format was detected, and what its reader has seen so far.

    `details` has the keys of `_modlens.Session.reading`; `forced` is True where `--from` names the
    format; `ended` is True when the recording has been read to its end. A recording that was
    skipped has an empty `format`, and the `reason`: it holds no Modbus, or it is `unreadable`.
    """

    name: str
    format: str
    confidence: float
    reason: str
    forced: bool
    details: dict[str, Any]
    ended: bool
    unreadable: bool = False


@dataclass(frozen=True, slots=True)
class PartialBatch:
    """Some rows of a batch; sinks take it as a `_modlens.Batch`.

    `whole` is the batch itself, for the core's writers of captures.
    """

    whole: _modlens.Batch
    frames: _modlens.Table
    transactions: _modlens.Table
    findings: _modlens.Table
    readings: _modlens.Table
    connections: _modlens.Table
    diagnoses: _modlens.Table


class Run(Protocol):
    """One pass over an input, a recording or a live tap."""

    def batches(self) -> Iterator[_modlens.Batch]:
        """Batches of decoded rows to the end of the input; some may be empty."""

    def finish(self) -> _modlens.Batch:
        """Decide what is still open when the caller takes no more batches, and give those rows."""

    def stats(self) -> dict[str, Any]:
        """Statistics so far; analyzer/views/stats.py documents the keys."""


class Sink(Protocol):
    """Takes batches: a file, a stream, a table on the screen."""

    name: str

    def put(self, batch: _modlens.Batch) -> None:
        """Write what the batch holds for this sink.

        `SourceError` if that fails, `BrokenPipeError` if nobody reads.
        """


class FileRun:
    """Decodes recordings one after the other, each as a bus of its own; frame numbers run on.

    A directory, a pattern, an archive or a mail stands for the recordings in it; what is not a
    recording is skipped and reported. `read_as` forces a format. With `replay` recordings are
    decoded without looking ahead, as by a live tap, and give its rows. With `follow` the last file
    may grow for ever. `data` are the bytes of recordings that are not files of that name.

    `on_status` gets the status of every recording after its first block and at its end.
    `SourceError` for the first name that cannot be read, before anything is decoded; later, while
    files are read.

    `unreadable` counts the recordings that could not be read, or not to their end: damaged,
    encrypted, cut off, too deep in archives.
    """

    def __init__(  # noqa: PLR0913 - how recordings are read
        self,
        names: Sequence[str],
        settings: Settings,
        *,
        read_as: str | None = None,
        replay: bool = False,
        on_status: Callable[[RecordingStatus], None] | None = None,
        follow: bool = False,
        data: Mapping[str, bytes] | None = None,
    ) -> None:
        self.unreadable = 0
        self._data = data or {}
        self._names = [
            recording
            for name in names
            for recording in self._recordings_of(name, unpack=read_as != RAW)
        ]
        for name in self._names:
            if name.text in self._data:
                continue
            if not name.found:
                if name.error is not None:
                    raise name.error
                check_readable(name.text)
        self._settings = settings
        self._read_as = read_as
        self._on_status = on_status
        self._follow = follow
        self._core = settings.core(live=replay or follow)
        self._decoded = 0

    def batches(self) -> Iterator[_modlens.Batch]:
        """The rows that each block decides; after the last block of a file, those still open."""
        troubles = []
        with Archives() as archives:
            for i, name in enumerate(self._names):
                follow = self._follow and i + 1 == len(self._names) and name.text != STDIN
                try:
                    yield from self._decode(name, archives, follow=follow)
                    self._decoded += 1
                except SourceError as error:
                    if not name.found:
                        raise
                    troubles.append(error)
                    self.unreadable += isinstance(error, CaptureError)
                    self._report_skipped(name.text, error)
        if troubles and not self._decoded:
            raise troubles[0]
        yield self.finish()

    def _decode(
        self, name: RecordingName, archives: Archives, *, follow: bool
    ) -> Iterator[_modlens.Batch]:
        if name.error is not None:
            raise name.error
        with FirstBytes(name.text) as first_bytes:
            while not first_bytes.have_come():
                yield self._core.take()
            recording = self._open(name, archives, follow=follow)
        with recording:
            yield from self._read_recording(recording)

    def finish(self) -> _modlens.Batch:
        """Decide what is still open, and give those rows, and the diagnoses if they are wanted."""
        self._core.flush()
        return self._core.conclude()

    def stats(self) -> dict[str, Any]:
        """Statistics so far; for the keys see analyzer/views/stats.py."""
        found: dict[str, Any] = json.loads(self._core.stats())
        return found

    def doctor(self) -> dict[str, Any]:
        """What the doctor says so far, with `diagnoses` among the tables; see views/health.py."""
        found: dict[str, Any] = json.loads(self._core.doctor())
        return found

    def _recordings_of(self, name: str, *, unpack: bool) -> list[RecordingName]:
        return [RecordingName(name)] if name in self._data else expand([name], unpack=unpack)

    def _open(self, name: RecordingName, archives: Archives, *, follow: bool) -> Recording:
        return Recording(
            name.text,
            data=self._data.get(name.text),
            read_as=self._read_as,
            dialects=self._settings.dialects,
            follow=follow,
            archives=archives,
        )

    def _read_recording(self, recording: Recording) -> Iterator[_modlens.Batch]:
        """Decode a recording block by block; captures and samples have methods of their own.

        The first status is reported when the first block has been read, the last one at the end.
        `SourceError` where no line of a text could be read.
        """
        core, form = self._core, recording.detection.format
        kind = FORMATS.get(form)
        if kind is not None and kind.packets:
            yield from self._read_packets(recording)
            return
        if kind is not None and kind.samples:
            yield from self._read_samples(recording)
            return
        bus = self._settings.add_bus(core, recording.name, clock="none")
        binary = is_binary(form)
        if not binary:
            self._open_text(recording, bus)
        first, idle = True, 0
        for block in recording.blocks():
            idle = 0 if block else idle + 1
            if binary:
                core.feed(bus, block)
            elif idle == _IDLE_READS_TO_SETTLE and self._follow:
                core.settle_text(bus)
            else:
                core.feed_text(bus, block)
            if first:
                self._report_status(recording, core.reading(bus), ended=False)
                first = False
            yield core.take()
        if not binary:
            core.feed_text(bus, b"", final=True)
        core.flush()
        self._report_status(recording, core.reading(bus), ended=True)
        if not binary and not json.loads(core.reading(bus))["records"]:
            raise SourceError(
                f"{recording.name}: no line could be read as {form}; see `modlens formats`"
            )
        yield core.take()

    def _read_packets(self, recording: Recording) -> Iterator[_modlens.Batch]:
        """Decode a network or serial capture block by block."""
        core = self._core
        capture = self._settings.add_capture(core, recording.name)
        first = True
        for block in recording.blocks():
            core.feed_capture(capture, block)
            if first:
                self._report_status(recording, core.capture(capture), ended=False)
                first = False
            yield core.take()
        core.feed_capture(capture, b"", final=True)
        core.flush(file=True)
        self._report_status(recording, core.capture(capture), ended=True)
        yield core.take()

    def _read_samples(self, recording: Recording) -> Iterator[_modlens.Batch]:
        """Decode samples of a logic analyser block by block.

        The core finds the serial lines among the channels. `SourceError` where there is none.
        """
        core = self._core
        with _samples_of(recording) as samples:
            logic = self._settings.add_logic(core, samples)
            for block in samples.blocks():
                core.feed_logic(logic, block)
                yield core.take()
            core.feed_logic(logic, b"", final=True)
            core.flush()
            found = json.loads(core.logic(logic))
            if not found["lines"]:
                raise SourceError(
                    f"{recording.name}: no Modbus on channels {', '.join(samples.names.values())};"
                    " name the line's channels by --channels and its settings by --line"
                )
            descriptions = [_describe_channel(samples.names, line) for line in found["lines"]]
            descriptions += [
                f"channel {samples.names[copy]} carries the same bytes" for copy in found["copies"]
            ]
            descriptions += [
                f"channel {samples.names[one]} is left out: a bus has two lines at most"
                for one in found["surplus"]
            ]
            details = {
                "clock": "relative",
                "resolution_ns": round(1e9 / samples.rate),
                "said": descriptions,
            }
            self._report_status(recording, json.dumps(details), ended=False)
            self._report_status(recording, json.dumps(details), ended=True)
        yield core.take()

    def _open_text(self, recording: Recording, bus: int) -> None:
        settings = self._settings
        self._core.open_text(
            bus,
            recording.detection.format,
            dialects=settings.dialects,
            ordered=recording.detection.forced,
            sample=recording.sample,
            zone=settings.zone,
            date=settings.date,
        )

    def _report_status(self, recording: Recording, reading: str, *, ended: bool) -> None:
        """Pass the status of a recording to `on_status`; `reading` is the core's JSON."""
        if self._on_status is None:
            return
        found = recording.detection
        details = json.loads(reading)
        if ended and recording.damage is not None:
            details["trouble"] = recording.damage
            self.unreadable += 1
        self._on_status(
            RecordingStatus(
                recording.name,
                found.format,
                found.confidence,
                found.reason,
                found.forced,
                details,
                ended,
            )
        )

    def _report_skipped(self, name: str, error: SourceError) -> None:
        if self._on_status is not None:
            reason = error.message.removeprefix(f"{name}: ")
            unreadable = isinstance(error, CaptureError)
            self._on_status(
                RecordingStatus(name, "", 0.0, reason, False, {}, ended=True, unreadable=unreadable)
            )


def _samples_of(recording: Recording) -> Samples | Levels:
    if recording.detection.format == "sigrok":
        return Samples(recording.name, recording.seekable())
    return Levels(recording.name, recording.blocks())


def _describe_channel(names: dict[int, str], line: dict[str, Any]) -> str:
    """A serial line that was found in samples of a logic analyser, in words."""
    idle = ", idle low" if line["inverted"] else ""
    return f"channel {names[line['channel']]}: {line['line']}{idle}"


def pump(
    run: Run,
    sinks: Sequence[Sink],
    *,
    stop: Callable[[], bool],
    on_failure: Callable[[Sink, SourceError | BrokenPipeError], None],
) -> None:
    """Pass the run's batches to the sinks until it ends, `stop()` is True, or no sink is left.

    A sink that cannot write is reported to `on_failure` and gets no more batches; the others go on.
    Errors of the input are raised after the sinks have got all rows decided before.
    """
    active = list(sinks)

    def put(batch: _modlens.Batch) -> None:
        for sink in tuple(active):
            try:
                sink.put(batch)
            except (SourceError, BrokenPipeError) as error:
                active.remove(sink)
                on_failure(sink, error)

    try:
        for batch in run.batches():
            put(batch)
            if stop() or not active:
                break
    finally:
        put(run.finish())
