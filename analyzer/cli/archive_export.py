"""`modlens export ... -o FOLDER --style partitions`: an archive into a folder that grows."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import _modlens
from analyzer.archive.folder import Export, ExportFolder, Stopped
from analyzer.archive.manifest import Entry
from analyzer.archive.recordings import ArchivedRecording, find_recordings
from analyzer.archive.side_by_side import Position, side_by_side
from analyzer.cli.between import combine_filters
from analyzer.cli.chosen_settings import settings
from analyzer.cli.messages import Messages
from analyzer.cli.stop_signals import StopSignals
from analyzer.columns import TABLES
from analyzer.cores import cores
from analyzer.counts import count_of
from analyzer.exports import format_of
from dissectors.errors import CaptureError, SourceError, UsageError

__all__ = ["is_archive_export", "run_archive_export"]

SIGNALLED = 128

_NOT_IN_ROWS = ("command", "files", "outputs", "threads", "strict", "style", "to")
"""Options that the rows in the folder do not depend on."""


def is_archive_export(options: argparse.Namespace) -> bool:
    """Whether the output of `--style partitions` is a folder that grows: a name without suffix.

    A name with a suffix, such as `log.parquet`, is that of one new folder.
    """
    folders = [_folder(text, "")[1] for text in options.outputs]
    return bool(folders) and not any(_has_format(folder) for folder in folders)


def run_archive_export(options: argparse.Namespace) -> int:
    """Export what is new in the archive; gives the exit status."""
    if len(options.outputs) != 1 or options.to is not None:
        raise UsageError("--style partitions: one folder at a time; name one -o FOLDER")
    if options.limit is not None or options.context:
        raise UsageError("--style partitions: a folder that grows takes no --limit or --context")
    table, path = _folder(options.outputs[0], options.table)
    messages = Messages(quiet=False)
    with StopSignals() as stop_signals:
        zone = "utc" if options.times == "utc" else "local"
        export = Export(
            table,
            settings(options),
            _version(options),
            columns=options.columns,
            where=combine_filters(options.where, options.between, zone=zone, table=table),  # type: ignore[arg-type]
            read_as=options.read_as,
            stop=stop_signals.received,
        )
        recordings = find_recordings(options.files, options.bus_names)
        with ExportFolder(path, export) as folder:
            done = _export(folder, recordings, options.threads or cores(), export, messages)
        if stop_signals.signal is not None:
            messages.error(f"interrupted: {done}; the same command goes on from here")
            return SIGNALLED + stop_signals.signal
    messages.info(f"{path}: {done}")
    return CaptureError.exit_status if done.damaged else 0


@dataclass(slots=True)
class _Done:
    """How many recordings have come to which end; `rows` are those of the new ones."""

    new: int = 0
    unchanged: int = 0
    copies: int = 0
    damaged: int = 0
    skipped: int = 0
    rows: int = 0
    total: int = 0

    def __str__(self) -> str:
        words = [
            f"{self.new + self.unchanged + self.copies + self.skipped} of"
            f" {count_of(self.total, 'recording')} done",
            f"{self.new:,} new with {count_of(self.rows, 'row')}",
            f"{self.unchanged:,} unchanged",
        ]
        words += [f"{self.copies:,} the same as others"] * bool(self.copies)
        words += [f"{self.damaged:,} damaged"] * bool(self.damaged)
        words += [f"{self.skipped:,} no recordings"] * bool(self.skipped)
        return ", ".join(words)


def _export(
    folder: ExportFolder,
    recordings: Sequence[ArchivedRecording],
    threads: int,
    export: Export,
    messages: Messages,
) -> _Done:
    """Export the recordings that the folder does not have."""
    done = _Done(total=len(recordings))
    waiting = list(_unknown(folder, recordings, done, messages))

    def work(recording: ArchivedRecording, position: Position) -> Entry | None:
        try:
            return folder.export(recording, position)
        except Stopped:
            return None

    for recording, entry in side_by_side(
        waiting, work, threads=threads, stop=export.stop, progress=messages.progress
    ):
        if entry is not None:
            folder.record(recording, entry)
            done.rows += entry.rows
            done.new += not entry.skipped
            _report(entry, done, messages)
    return done


def _unknown(
    folder: ExportFolder,
    recordings: Sequence[ArchivedRecording],
    done: _Done,
    messages: Messages,
) -> Iterator[ArchivedRecording]:
    """The recordings that the folder does not have yet, or not as they are now."""
    for recording in recordings:
        try:
            entry = folder.manifest.known(recording)
        except (OSError, SourceError):
            entry = None  # the one who decodes it says what is wrong
        if entry is None:
            yield recording
            continue
        if entry.name == recording.name:
            done.unchanged += not entry.skipped
            _report(entry, done, messages)
        else:
            done.copies += 1
        folder.manifest.note(recording, entry)


def _report(entry: Entry, done: _Done, messages: Messages) -> None:
    if entry.trouble is None:
        return
    done.skipped += entry.skipped
    done.damaged += not entry.skipped
    say = messages.info if entry.skipped else messages.error
    say(f"{entry.name}: {'skipped: ' if entry.skipped else ''}{entry.trouble}")


def _folder(text: str, table: str) -> tuple[str, str]:
    """Table and folder of a value of `-o`."""
    head, colon, rest = text.partition(":")
    return (head, rest) if colon and head in TABLES else (table, text)


def _has_format(name: str) -> bool:
    try:
        format_of(name.rstrip("/" + os.sep))
    except UsageError:
        return False
    return True


def _version(options: argparse.Namespace) -> str:
    """Everything that rows depend on besides the recordings, as text."""
    values = {name: value for name, value in vars(options).items() if name not in _NOT_IN_ROWS}
    files = [
        name.partition("=")[2] or name
        for key in ("profiles", "functions", "dialects")
        for name in values.get(key) or ()
    ]
    if options.bus is not None:
        files.append(options.bus.partition(":")[0])
    contents = {name: _content(name) for name in files}
    return json.dumps([_modlens.__version__, values, contents], sort_keys=True, default=str)


def _content(name: str) -> str | None:
    """The hash of a file; None where the name is not that of a file."""
    try:
        with open(name, "rb") as file:
            return hashlib.sha256(file.read()).hexdigest()
    except OSError:
        return None
