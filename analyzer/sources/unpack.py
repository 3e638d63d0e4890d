"""The recordings that a command line names: files, directories, patterns, archives, mail.

A file inside an archive is called `archive!member`. Nothing is written to disk.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import IO, Self

from analyzer.sources.archives import MEMBER_SEPARATOR, Member, contents
from dissectors.errors import CaptureError, SourceError

__all__ = ["Archives", "RecordingName", "expand"]

MAX_NESTING = 3
"""Archives in archives; a deeper one is reported as one that can't be read."""


@dataclass(frozen=True, slots=True)
class RecordingName:
    """A recording; `found` says that nobody named it: it may be something else.

    `error` says why it can't be read, where that is known already.
    """

    text: str
    found: bool = False
    error: CaptureError | None = None


def expand(names: list[str], *, unpack: bool = True) -> list[RecordingName]:
    """The recordings that these names mean.

    A directory stands for the regular files in it, a pattern for those that fit, an archive or mail
    for what is in it. `SourceError` if that is nothing.
    """
    found: list[RecordingName] = []
    for name in names:
        paths = [name]
        if os.path.isdir(name):
            paths = sorted(_walk(name))
        elif any(mark in name for mark in "*?[") and not os.path.lexists(name):
            import glob  # noqa: PLC0415

            paths = sorted(glob.glob(name, recursive=True))
        if not paths:
            raise SourceError(f"{name}: no files; check the path")
        for path in paths:
            name_of_path = RecordingName(path, found=path != name)
            found += _recordings(name_of_path) if unpack else [name_of_path]
    return found


def _walk(folder: str) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(one for one in folders if not one.startswith("."))
        paths = (os.path.join(place, one) for one in files if not one.startswith("."))
        # A FIFO would wait for a writer for ever, and a device has no end.
        yield from (path for path in paths if os.path.isfile(path) or os.path.islink(path))


def _recordings(name: RecordingName) -> list[RecordingName]:
    """The file itself, or what is in it where it is an archive or a mail."""
    if not os.path.isfile(name.text):
        return [name]
    try:
        with Archives() as archives:
            members = list(_members(archives, name.text, MAX_NESTING))
    except CaptureError as error:
        return [replace(name, error=error)]
    except OSError:
        return [name]  # the one who opens it says why it cannot be read
    if members == [name.text]:
        return [name]
    return [RecordingName(member, found=True) for member in members]


def _members(archives: Archives, name: str, depth: int) -> Iterator[str]:
    """The names below `name`; `name` alone where it holds nothing, or too deep to look."""
    inside = archives.members(name) if depth else None
    if inside is None:
        yield name
        return
    for member in inside:
        below = f"{name}{MEMBER_SEPARATOR}{member}"
        try:
            yield from list(_members(archives, below, depth - 1))
        except CaptureError:
            yield below  # the one who opens it says why it cannot be read


class Archives:
    """Archives that stay open while one member after the other is read.

    To list an archive of thousands of members again for each of them would take quadratic time, and
    so would starting again at the front of a compressed tar. Use it in `with`.
    """

    def __init__(self) -> None:
        # The archive that was opened last, after it the archive inside it, and so on.
        self._chain: list[tuple[str, ExitStack, dict[str, Member] | None]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._keep(0)

    def open(self, name: str) -> IO[bytes] | None:
        """The bytes of `archive!member`; None if the name is not of that form.

        `CaptureError` if the archive or the member cannot be read.
        """
        path, *rest = name.split(MEMBER_SEPARATOR)
        while rest and not os.path.isfile(path):
            path = f"{path}{MEMBER_SEPARATOR}{rest.pop(0)}"
        if not rest or os.path.lexists(name):
            return None
        place, left = path, MEMBER_SEPARATOR.join(rest)
        while left:
            inside = self._inside(place) or {}
            member = _longest_beginning(left, inside)
            if member is None:
                raise SourceError(f"{name}: not found in {place}")
            left = left[len(member) + 1 :]
            if not left:
                return inside[member].open()
            place = f"{place}{MEMBER_SEPARATOR}{member}"
        return None

    def members(self, name: str) -> list[str] | None:
        """The names in an archive or mail, in its order; None if it is neither."""
        inside = self._inside(name)
        return None if inside is None else list(inside)

    def _inside(self, name: str) -> dict[str, Member] | None:
        for depth, (place, _, inside) in enumerate(self._chain):
            if place == name:
                self._keep(depth + 1)
                return inside
        depth = sum(name.startswith(place + MEMBER_SEPARATOR) for place, _, _ in self._chain)
        self._keep(depth)
        opened = ExitStack()
        try:
            file = opened.enter_context(self._bytes(name))
            listed = contents(file, name, opened)
        except BaseException:
            opened.close()
            raise
        inside = None if listed is None else {member.name: member for member in listed}
        self._chain.append((name, opened, inside))
        return inside

    def _bytes(self, name: str) -> IO[bytes]:
        if self._chain:
            parent, _, inside = self._chain[-1]
            member = name.removeprefix(parent + MEMBER_SEPARATOR)
            if inside is not None and member in inside:
                return inside[member].open()
        return open(name, "rb")

    def _keep(self, depth: int) -> None:
        """Closes what is below this depth, the innermost first."""
        while len(self._chain) > depth:
            self._chain.pop()[1].close()


def _longest_beginning(name: str, members: Mapping[str, object]) -> str | None:
    """The member that a name means or goes through: names may hold the mark themselves.

    >>> _longest_beginning("a!b!c", {"a": 0, "a!b": 0})
    'a!b'
    """
    while name not in members:
        name, mark, _ = name.rpartition(MEMBER_SEPARATOR)
        if not mark:
            return None
    return name
