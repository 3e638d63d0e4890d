"""An archive as a folder of Parquet files, `date=2026-11-21/bus=pumps/KEY.parquet`, that grows.

Each recording has files of its own, written aside and put in place when all of them are complete;
then the manifest gets a line. So whatever ends the program, a recording is in the folder as a whole
or will be exported again, and nothing is there twice: what no line of the manifest names is deleted
when the next export begins. When a recording has changed, its old files are deleted as the new ones
are put in place.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from analyzer.archive.manifest import Entry, Manifest, stamps_of
from analyzer.archive.recordings import ArchivedRecording, content_of
from analyzer.archive.side_by_side import Position
from analyzer.exports import ExportOptions
from analyzer.exports.output import as_source_error
from analyzer.exports.sink import ExportSink, Target
from analyzer.pump import pump
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from dissectors.errors import CaptureError, SourceError

__all__ = ["PARTITIONS", "Export", "ExportFolder", "Stopped"]

PARTITIONS = "partitions"
"""The style of Parquet exports that makes folders."""

_WORK = "_unfinished"
"""The folder for what is not complete. Readers of folders leave out what begins with `_`."""

_PART = re.compile(r"[0-9a-f]{32}\.parquet")


class Stopped(Exception):  # noqa: N818 - not an error
    """The export of a recording has been stopped; nothing of it is in the folder."""


@dataclass(frozen=True, slots=True)
class Export:
    """What is exported of each recording, and how it is decoded.

    `version` is what rows depend on besides the recording, as text: options, and the program.
    """

    table: str
    settings: Settings
    version: str
    columns: str | None = None
    where: str | None = None
    read_as: str | None = None
    stop: Callable[[], bool] = field(default=lambda: False)

    @property
    def key(self) -> str:
        """A hash of it for the manifest."""
        parts = (self.table, self.columns, self.where, self.read_as, self.version)
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


class ExportFolder:
    """A folder with the rows of one table; use it in `with`. `SourceError` if it cannot be written.

    `add` may be called by several threads at once, `record` by one.
    """

    def __init__(self, path: str, export: Export) -> None:
        self._path = path
        self._export = export
        self.manifest = Manifest(path, export.key)
        try:
            self._tidy()
            os.makedirs(os.path.join(path, _WORK), exist_ok=True)
        except OSError as error:
            self.manifest.__exit__()
            raise as_source_error(path, error) from error

    def __enter__(self) -> ExportFolder:
        return self

    def __exit__(self, *error: object) -> None:
        shutil.rmtree(os.path.join(self._path, _WORK), ignore_errors=True)
        self.manifest.__exit__(*error)

    def export(self, recording: ArchivedRecording, position: Position) -> Entry:
        """Decode a recording into files that stand aside; `record` puts them in place.

        A recording that cannot be read gets an entry with `trouble`, and is tried again next time.
        `Stopped` if `stop()` of the export was True before its end.
        """
        try:
            entry = Entry(
                recording.name,
                stamps_of(recording),
                content_of(recording.paths),
                self._export.key,
                recording.bus,
                (),
                0,
            )
        except (OSError, SourceError) as error:
            return Entry(recording.name, (), "", "", recording.bus, (), 0, trouble=_text(error))
        key = hashlib.sha256(f"{entry.content} {entry.bus} {entry.settings}".encode()).hexdigest()
        work = self._work(recording)
        shutil.rmtree(work, ignore_errors=True)
        rows, trouble, skipped = self._decode(recording, work, position)
        parts = [
            os.path.join(os.path.dirname(part), f"{key[:32]}.parquet") for part in _files(work)
        ]
        return replace(
            entry, parts=tuple(sorted(parts)), rows=rows, trouble=trouble, skipped=skipped
        )

    def record(self, recording: ArchivedRecording, entry: Entry) -> None:
        """Put the files of a recording in place, in place of those that it had."""
        try:
            old = self.manifest.superseded(recording)
            if old is not None:
                self._delete(old, entry)
            for part in entry.parts:
                place = os.path.join(self._path, part)
                os.makedirs(os.path.dirname(place), exist_ok=True)
                aside = os.path.join(self._work(recording), os.path.dirname(part))
                os.replace(os.path.join(aside, "part-0.parquet"), place)
        except OSError as error:
            raise as_source_error(self._path, error) from error
        self.manifest.add(entry)

    def _work(self, recording: ArchivedRecording) -> str:
        """Where the files of a recording stand until they are complete."""
        name = hashlib.sha256(os.fsencode(recording.paths[0])).hexdigest()[:32]
        return os.path.join(self._path, _WORK, name)

    def _decode(
        self, recording: ArchivedRecording, work: str, position: Position
    ) -> tuple[int, str | None, bool]:
        """The rows written, what is wrong with the recording, and whether the file is none."""
        troubles: list[str] = []
        failures: list[SourceError | BrokenPipeError] = []

        def listen(status: RecordingStatus) -> None:
            trouble = status.details.get("trouble") or (
                status.reason if status.unreadable else None
            )
            if trouble is not None:
                troubles.append(trouble)

        export = self._export
        sink = ExportSink(
            Target(export.table, "parquet", work),
            columns=export.columns,
            where=export.where,
            growing=False,
            options=ExportOptions("", (), style=PARTITIONS),
        )
        skipped = False
        try:
            run = FileRun(
                recording.paths,
                replace(export.settings, tables=(export.table,), bus_name=recording.bus),
                read_as=export.read_as,
                on_status=listen,
                progress=position,
            )
            pump(run, [sink], stop=export.stop, on_failure=lambda _, error: failures.append(error))
        except SourceError as error:
            skipped = not isinstance(error, CaptureError)
            troubles.append(error.message.removeprefix(f"{recording.name}: "))
        if failures or export.stop():
            sink.rollback()
            raise failures[0] if failures else Stopped
        sink.close()
        return sink.row_count, "; ".join(troubles) or None, skipped

    def _delete(self, old: Entry, new: Entry) -> None:
        """Delete the files of what a recording was, but those that another one has as well."""
        others = {
            part
            for entry in self.manifest.entries
            if entry.name != old.name
            for part in entry.parts
        }
        for part in {*old.parts} - others - {*new.parts}:
            Path(self._path, part).unlink(missing_ok=True)

    def _tidy(self) -> None:
        """Delete what a program that was killed has left."""
        shutil.rmtree(os.path.join(self._path, _WORK), ignore_errors=True)
        known = {part for entry in self.manifest.entries for part in entry.parts}
        for part in _files(self._path):
            if _PART.fullmatch(os.path.basename(part)) and part not in known:
                os.unlink(os.path.join(self._path, part))


def _files(folder: str) -> Iterator[str]:
    """The files of partitions in a folder, as paths below it."""
    for path in Path(folder).glob("date=*/bus=*/*.parquet"):
        yield str(path.relative_to(folder))


def _text(error: OSError | SourceError) -> str:
    return error.message if isinstance(error, SourceError) else str(error.strerror or error)
