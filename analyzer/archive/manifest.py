"""What a folder of exports holds, recording by recording: a line of JSON for each in a file.

The last line of a recording counts. A line that a crash has cut off is left out. A recording is
known by the hash of its content; where size and time of its files are as before, that is not taken
again.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

from analyzer.archive.recordings import ArchivedRecording, content_of
from analyzer.exports.output import as_source_error
from dissectors.errors import SourceError

if TYPE_CHECKING:
    from io import FileIO

__all__ = ["NAME", "Entry", "Manifest", "stamps_of"]

NAME = "_manifest.jsonl"
"""Its name in the folder. Readers of folders leave out what begins with `_`."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A recording in the folder.

    - `name`: of its first file; `stamps`: size and time of change (ns) of its files
    - `content`: the hash of its bytes; `settings`: that of everything that rows depend on besides
    - `bus`: the name of its bus, null where that is the path
    - `parts`: the files with its rows, below the folder; `rows`: how many these are
    - `trouble`: why it could not be read, or not to its end; null if it could
    - `skipped`: whether it is no recording at all
    """

    name: str
    stamps: tuple[tuple[int, int], ...]
    content: str
    settings: str
    bus: str | None
    parts: tuple[str, ...]
    rows: int
    trouble: str | None = None
    skipped: bool = False


class Manifest:
    """The manifest of a folder, which is made if it is not there; use it in `with`.

    Only one program at a time may write into the folder: `SourceError` if there is another.
    """

    def __init__(self, folder: str, settings: str) -> None:
        self._folder = folder
        self._settings = settings
        self._entries: dict[str, Entry] = {}
        try:
            os.makedirs(folder, exist_ok=True)
            self._file: FileIO = open(os.path.join(folder, NAME), "ab+", buffering=0)
        except OSError as error:
            raise as_source_error(folder, error) from error
        try:
            _lock(self._file.fileno(), folder)
            self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Manifest:
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()

    @property
    def entries(self) -> Sequence[Entry]:
        """All recordings."""
        return tuple(self._entries.values())

    def known(self, recording: ArchivedRecording) -> Entry | None:
        """The entry of a recording that has not changed since it was exported with these settings.

        It may have another name: that of a file with the same content, of the same bus.
        """
        entry = self._entries.get(recording.name)
        if self._holds(entry, recording) and entry.stamps == stamps_of(recording):  # type: ignore[union-attr]
            return entry
        content = content_of(recording.paths)
        same = [one for one in self._entries.values() if one.content == content]
        return next((one for one in same if self._holds(one, recording)), None)

    def superseded(self, recording: ArchivedRecording) -> Entry | None:
        """The entry of what this recording was before it changed."""
        return self._entries.get(recording.name)

    def note(self, recording: ArchivedRecording, entry: Entry) -> None:
        """Write down that a recording is what this entry has, so that it is not read again."""
        seen = replace(entry, name=recording.name, stamps=stamps_of(recording))
        if self._entries.get(recording.name) != seen:
            self.add(seen)

    def add(self, entry: Entry) -> None:
        """Write down a recording, in place of that of the same name."""
        data = json.dumps(asdict(entry), ensure_ascii=True).encode() + b"\n"
        try:
            self._file.write(data)
            os.fsync(self._file.fileno())
        except OSError as error:
            raise as_source_error(self._file.name, error) from error
        self._entries[entry.name] = entry

    def _holds(self, entry: Entry | None, recording: ArchivedRecording) -> bool:
        return (
            entry is not None
            and (entry.settings, entry.bus) == (self._settings, recording.bus)
            and all(_is_whole(os.path.join(self._folder, part)) for part in entry.parts)
        )

    def _read(self) -> None:
        self._file.seek(0)
        data = self._file.read() or b""
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            self._file.truncate(len(whole))
        for entry in _parsed(whole):
            self._entries[entry.name] = entry


def _parsed(data: bytes) -> Iterator[Entry]:
    for line in data.splitlines():
        with contextlib.suppress(ValueError, TypeError, KeyError):
            found = json.loads(line)
            found["stamps"] = tuple(tuple(stamp) for stamp in found["stamps"])
            found["parts"] = tuple(found["parts"])
            yield Entry(**found)


def _is_whole(path: str) -> bool:
    """Whether a file of Parquet is there to its end: its footer and the length of that fit."""
    try:
        with open(path, "rb") as file:
            start = file.read(len(_MAGIC))
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - _TAIL_BYTES))
            tail = file.read()
    except OSError:
        return False
    footer = int.from_bytes(tail[:4], "little")
    return start == _MAGIC == tail[4:] and footer + _TAIL_BYTES + len(_MAGIC) <= size


_MAGIC = b"PAR1"
_TAIL_BYTES = 8
"""The length of the footer and the magic number end the file (Parquet format, File format)."""


def stamps_of(recording: ArchivedRecording) -> tuple[tuple[int, int], ...]:
    """Size and time of the last change of the files of a recording."""
    return tuple((there.st_size, there.st_mtime_ns) for there in map(os.stat, recording.paths))


def _lock(file: int, folder: str) -> None:
    """Keep other programs out, as long as this one lives; Windows has no such lock."""
    try:
        import fcntl  # noqa: PLC0415 - not everywhere
    except ImportError:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise SourceError(f"{folder}: another export writes into this folder") from error
