"""The recordings of an archive: files that belong together, and the bus that they are of.

>>> name_of_bus("archive/pumps/monday.log", "archive", "folder")
'pumps'
>>> name_of_bus("archive/monday/pumps.log", "archive", "stem")
'pumps'
"""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from analyzer.sources.files import printable_name
from analyzer.sources.pipes import STDIN
from analyzer.sources.unpack import expand
from dissectors.errors import SourceError

__all__ = ["ArchivedRecording", "content_of", "find_recordings", "name_of_bus"]

_HEAD_BYTES = 4096
_SEGMENT = re.compile(rb"recording session=(\S+) segment=(\d+)")
"""States which session a raw recording of a tap belongs to (modlens-pcapng/src/recording.rs)."""

_HASHED_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class ArchivedRecording:
    """A recording: one file, or the segments of a tap's, in order. `bus` is None for its path's."""

    paths: tuple[str, ...]
    bus: str | None
    size: int

    @property
    def name(self) -> str:
        """The name of its first file, as text."""
        return printable_name(self.paths[0])


def find_recordings(names: Sequence[str], bus_names: str) -> list[ArchivedRecording]:
    """The recordings in these files, directories and patterns, by name.

    `bus_names` is one of `analyzer.archive.BUS_NAMES`. `SourceError` for a name that stands for
    nothing.
    """
    found: dict[str, ArchivedRecording] = {}
    sessions: dict[tuple[bytes, str | None], tuple[str, dict[int, str]]] = {}
    for name in names:
        if name == STDIN:
            found[name] = ArchivedRecording((name,), None, 0)
            continue
        root = _root(name)
        for path in (one.text for one in expand([name], unpack=False)):
            if not os.path.isfile(path):
                if path == name:
                    raise SourceError(f"{path}: no such file")
                continue
            bus = name_of_bus(path, root, bus_names)
            segment = _segment(path)
            if segment is None:
                found[path] = ArchivedRecording((path,), bus, os.path.getsize(path))
                continue
            first, segments = sessions.setdefault((segment[0], bus), (path, {}))
            segments[segment[1]] = path
            found[first] = ArchivedRecording((first,), bus, 0)
    for first, segments in sessions.values():
        paths = tuple(path for _, path in sorted(segments.items()))
        size = sum(map(os.path.getsize, paths))
        found[first] = replace(found[first], paths=paths, size=size)
    return sorted(found.values(), key=lambda one: one.paths)


def name_of_bus(path: str, root: str, bus_names: str) -> str | None:
    """The bus of a file below `root`; None where it is called as the path.

    - `folder`: its folder below the root, or its own name without suffix where there is none
    - `stem`: its own name without suffix
    - `path`: its path, as everywhere else
    """
    if bus_names == "path":
        return None
    folder = os.path.dirname(os.path.relpath(path, root or "."))
    base = os.path.basename(path)
    if bus_names == "folder" and folder:
        return printable_name(folder.replace(os.sep, "/"))
    return printable_name(base.split(".")[0] or base)


def content_of(paths: Iterable[str]) -> str:
    """The SHA-256 of the bytes of some files, each with its length. `SourceError` if unreadable."""
    digest = hashlib.sha256()
    for path in paths:
        try:
            with open(path, "rb", buffering=0) as file:
                digest.update(b"%d:" % os.fstat(file.fileno()).st_size)
                while block := file.read(_HASHED_BYTES):
                    digest.update(block)
        except OSError as error:
            raise SourceError(f"{path}: cannot be read: {error.strerror}") from error
    return digest.hexdigest()


def _root(name: str) -> str:
    """The part of a name that is no pattern: a directory, or that of a file."""
    if os.path.isdir(name):
        return name
    root = name
    while glob.has_magic(root) and not os.path.lexists(root):
        root = os.path.dirname(root)
    return root if os.path.isdir(root) else os.path.dirname(root)


def _segment(path: str) -> tuple[bytes, int] | None:
    """Session and number of a segment of a raw recording; None for any other file."""
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return None  # the one who decodes it says why it cannot be read
    found = _SEGMENT.search(head) if head.startswith(b"\x0a\x0d\x0d\x0a") else None
    return None if found is None else (found[1], int(found[2]))
