"""The folders whose recordings an assistant may read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

from analyzer.sources.archives import MEMBER_SEPARATOR
from dissectors.errors import SourceError, UsageError

__all__ = ["Fence"]


class Fence:
    """The folders that were named at the start; whatever a path resolves to must be in one.

    `SourceError` for a folder that does not exist.
    """

    def __init__(self, folders: Sequence[str]) -> None:
        for folder in folders:
            if not os.path.isdir(folder):
                raise SourceError(f"{folder}: no such folder; name one that holds recordings")
        self._folders = [(folder, os.path.realpath(folder)) for folder in folders]

    def resolve(self, name: str) -> str:
        """The path of a file: `name` itself, or `name` in one of the folders.

        The member of an archive is named `archive!member`. `UsageError` for what is outside, is no
        regular file or does not exist: an assistant must not learn which of the three it is.
        """
        for path in (name, *(os.path.join(folder, name) for folder, _ in self._folders)):
            archive = path.partition(MEMBER_SEPARATOR)[0]
            if self._is_inside(path) or (archive != path and self._is_inside(archive)):
                return path
        raise UsageError(f"{name!r}: no such recording; overview without a file lists them")

    def files(self) -> Iterator[tuple[str, int]]:
        """All files with their sizes in bytes, in order; hidden ones are left out."""
        for folder, _ in self._folders:
            for place, folders, names in os.walk(folder):
                folders[:] = sorted(one for one in folders if not one.startswith("."))
                for name in sorted(one for one in names if not one.startswith(".")):
                    path = os.path.join(place, name)
                    if self._is_inside(path):
                        yield path, os.path.getsize(path)

    def _is_inside(self, path: str) -> bool:
        """Whether a path is a regular file that lies in a folder, all links followed."""
        try:
            real = os.path.realpath(path)
            if not os.path.isfile(real):
                return False
            return any(os.path.commonpath((real, root)) == root for _, root in self._folders)
        except (OSError, ValueError):
            return False
