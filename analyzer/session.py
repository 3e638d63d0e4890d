r"""From sources to sinks: feeds recordings to the core and passes its batches on.

A `FileRun` goes through recordings; `analyzer.live_run` has the run that listens to ports. Both
give batches one after the other, as they are decoded, so that memory does not grow with the input;
`analyzer.pump` passes them to sinks. Nothing here looks at a frame.

>>> from analyzer.settings import Settings
>>> import tempfile, pathlib
>>> path = pathlib.Path(tempfile.mkdtemp()) / "bus.hex"
>>> _ = path.write_text("010300000001840a\n0103020007f986\n")
>>> run = FileRun([str(path)], Settings())
>>> [row.status for batch in run.batches() for row in batch.transactions]
['ok']
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol

import _modlens
from analyzer.doubts import doubts
from analyzer.settings import Settings
from analyzer.sources import BINARY, is_binary
from analyzer.sources.files import RAW, Recording, check_readable, size_of
from analyzer.sources.pipes import STDIN, FirstBytes
from analyzer.sources.unpack import Archives, RecordingName, expand
from dissectors.errors import CaptureError, SourceError

if TYPE_CHECKING:
    from analyzer.sources.saleae import Levels
    from analyzer.sources.sigrok import Samples

__all__ = ["FileRun", "RecordingStatus"]

_IDLE_READS_TO_SETTLE = 5
"""Reads of a growing file without new data (half a second) after which its rows are decided."""


_BLOCKS_AT_ONCE = 4
"""So many are read ahead together: for each alone, threads would wait for each other too often."""


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


class Progress(Protocol):
    """Gets how far the reading of recordings has come."""

    def advance(self, done: int, total: int | None) -> None:
        """So many bytes of the files have been read, of so many; None where that is not known."""

    def wipe(self) -> None:
        """Nothing more is read for now."""


class FileRun:
    """Decodes recordings one after the other, each as a bus of its own; frame numbers run on.

    A directory, a pattern, an archive or a mail stands for the recordings in it; what is not a
    recording is skipped and reported. `read_as` forces a format. With `replay` recordings are
    decoded without looking ahead, as by a live tap, and give its rows. With `follow` the last file
    may grow for ever. `data` are the bytes of recordings that are not files of that name.

    A file is read once, also if it is named twice. `notify` gets a sentence about that, and about
    what is doubtful at the end (`analyzer.doubts`).

    `on_status` gets the status of every recording after its first block and at its end, `progress`
    is informed of every block. Recordings are read by `ahead`, which makes the items of an
    iterator before they are asked for (`analyzer.pool`); without it, between two blocks.
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
        notify: Callable[[str], None] = lambda _: None,
        follow: bool = False,
        data: Mapping[str, bytes] | None = None,
        progress: Progress | None = None,
        ahead: Callable[[Iterator[Any]], Generator[Any, None, None]] | None = None,
    ) -> None:
        self.unreadable = 0
        self._ahead = ahead
        self._progress = progress
        self._recording: Recording | None = None
        self._data = data or {}
        self._notify = notify
        self._names = self._each_once(
            recording
            for name in names
            for recording in self._recordings_of(name, unpack=read_as != RAW)
        )
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
        self._concluded = False
        self._at = 0

    def batches(self) -> Iterator[_modlens.Batch]:
        """The rows that each block decides; after the last block of a file, those still open."""
        if self._progress is None:
            yield from self._batches()
            return
        sizes = [size_of(name.text) for name in self._names]
        total = None if None in sizes else sum(filter(None, sizes))
        try:
            for batch in self._batches():
                if self._recording is not None:
                    done = sum(filter(None, sizes[: self._at])) + self._recording.position
                    self._progress.advance(done, total)
                yield batch
        finally:
            self._progress.wipe()

    def _batches(self) -> Iterator[_modlens.Batch]:
        troubles = []
        with Archives() as archives:
            for i, name in enumerate(self._names):
                self._at = i
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
        for text in doubts(self._settings, self.stats()):
            self._notify(text)

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
            self._recording = recording
            yield from self._read_recording(recording)
            self._recording = None

    def finish(self) -> _modlens.Batch:
        """Decide what is still open, and give those rows.

        The first call also gives the diagnoses if they are wanted.
        """
        if self._progress is not None:
            self._progress.wipe()
        self._core.flush()
        if self._concluded:
            return self._core.take()
        self._concluded = True
        return self._core.conclude()

    def stats(self) -> dict[str, Any]:
        """Statistics so far; for the keys see analyzer/views/stats.py."""
        found: dict[str, Any] = json.loads(self._core.stats())
        return found

    def doctor(self) -> dict[str, Any]:
        """What the doctor says so far, with `diagnoses` among the tables; see views/health.py."""
        found: dict[str, Any] = json.loads(self._core.doctor())
        return found

    def events(self) -> list[dict[str, Any]]:
        """The events of troubles since the last call, where the last file is followed."""
        return [json.loads(event) for event in self._core.take_events()]

    def document(self) -> dict[str, Any]:
        """Doctor, statistics and overview so far; the latter two if they are wanted.

        docs/stats.schema.json describes them; `analyzer.report.document` completes them.
        """
        found: dict[str, Any] = json.loads(self._core.document())
        return found

    def _recordings_of(self, name: str, *, unpack: bool) -> list[RecordingName]:
        return [RecordingName(name)] if name in self._data else expand([name], unpack=unpack)

    def _each_once(self, recordings: Iterable[RecordingName]) -> list[RecordingName]:
        """The recordings without files that came before, perhaps by another name."""
        found: dict[str, RecordingName] = {}
        for one in recordings:
            is_file = one.text not in self._data and one.text != STDIN
            if (
                found.setdefault(os.path.realpath(one.text) if is_file else one.text, one)
                is not one
            ):
                self._notify(f"{one.text}: named twice, read once")
        return list(found.values())

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
        kind = BINARY.get(form)
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
        blocks = recording.blocks()
        for block in blocks:
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
            if self._ahead is not None:
                yield from self._read_ahead(blocks, core.lend_reader(bus))
        if not binary:
            core.feed_text(bus, b"", final=True)
        core.flush()
        reading = core.reading(bus)
        self._report_status(recording, reading, ended=True)
        # An archive of thousands of small recordings must not keep what was learned from each.
        core.close(bus)
        if not binary and not json.loads(reading)["records"]:
            raise SourceError(
                f"{recording.name}: no line could be read as {form}; see `modlens formats`"
            )
        yield core.take()

    def _read_packets(self, recording: Recording) -> Iterator[_modlens.Batch]:
        """Decode a network or serial capture block by block."""
        core = self._core
        capture = self._settings.add_capture(core, recording.name)
        first = True
        # Of a capture a fourth is Modbus, so that blocks are larger: many gave no row, and each of
        # them is a turn of all that is done with rows.
        blocks = recording.blocks(_BLOCKS_AT_ONCE)
        for block in blocks:
            core.feed_capture(capture, block)
            if first:
                self._report_status(recording, core.capture(capture), ended=False)
                first = False
            yield core.take()
            if self._ahead is not None:
                yield from self._read_ahead(blocks, core.lend_capture_reader(capture), at_once=1)
        core.feed_capture(capture, b"", final=True)
        core.flush(file=True)
        self._report_status(recording, core.capture(capture), ended=True)
        core.close_capture(capture)
        yield core.take()

    def _read_ahead(
        self, blocks: Iterator[bytes], reader: _modlens.Reader, at_once: int = _BLOCKS_AT_ONCE
    ) -> Iterator[_modlens.Batch]:
        """Decode all further blocks, which are read meanwhile; the session has lent the reader."""
        assert self._ahead is not None
        with closing(self._ahead(_read_several(reader, blocks, at_once))) as found:
            for several in found:
                for block in several:
                    yield self._core.take_read(block)
        self._core.take_back(reader)

    def _read_samples(self, recording: Recording) -> Iterator[_modlens.Batch]:
        """Decode samples of a logic analyzer block by block.

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
                f"channel {_channel(samples.names, copy)} carries the same bytes"
                for copy in found["copies"]
            ]
            descriptions += [
                f"channel {_channel(samples.names, one)} is left out: a bus has two lines at most"
                for one in found["surplus"]
            ]
            details = {
                "clock": "relative",
                "resolution_ns": round(1e9 / samples.rate),
                "said": descriptions,
            }
            self._report_status(recording, json.dumps(details), ended=False)
            self._report_status(recording, json.dumps(details), ended=True)
            core.close_logic(logic)
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


def _read_several(
    reader: _modlens.Reader, blocks: Iterator[bytes], at_once: int
) -> Iterator[list[_modlens.ReadBlock]]:
    """What is in all blocks, so many blocks at a time."""
    while several := list(islice(blocks, at_once)):
        yield reader.read(several)


def _samples_of(recording: Recording) -> Samples | Levels:
    from analyzer.sources.saleae import Levels  # noqa: PLC0415 - samples are rare
    from analyzer.sources.sigrok import Samples  # noqa: PLC0415

    if recording.detection.format == "sigrok":
        return Samples(recording.name, recording.seekable())
    return Levels(recording.name, recording.blocks())


def _describe_channel(names: dict[int, str], line: dict[str, Any]) -> str:
    """A serial line that was found in samples of a logic analyzer, in words."""
    idle = ", idle low" if line["inverted"] else ""
    return f"channel {_channel(names, line['channel'])}: {line['line']}{idle}"


def _channel(names: dict[int, str], number: int) -> str:
    """The name of a channel; its number where the session has samples of it but no name."""
    return names.get(number, str(number))
