"""Where exported bytes go: a file that appears when complete, a growing file, standard output.

No export is left incomplete under its name: a file is written under a temporary name beside its
place and renamed at the end, to `NAME.partial` where a signal has interrupted the export, so that
an older file of the name stays. A live tap can end at any moment, so its file grows in place, block
by block, and never replaces an existing file. Its FIFOs are written by threads, which wait for
readers.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
import time
from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

import _modlens
from analyzer.counts import count_of
from analyzer.exports.detached_pipe import DetachedPipe
from analyzer.visible import for_terminal
from dissectors.errors import SourceError

__all__ = [
    "AtomicFile",
    "GrowingFile",
    "NewAtomicFile",
    "Output",
    "StandardOutput",
    "TappedFifo",
    "append_pieces",
    "as_source_error",
    "is_fifo",
    "is_special",
    "open_output",
    "partial_name",
]

T = TypeVar("T")

LOOK_S = 0.05
"""So often an export looks whether its FIFO has a reader, or the user has stopped it."""


class Output(Protocol):
    """Takes the bytes of one export.

    Every method raises `SourceError` if the bytes cannot be written.
    """

    name: str
    remark: str
    """What the user should know of the complete output; mostly empty."""

    def append(self, data: bytes) -> None:
        """Append these bytes."""

    def close(self, *, interrupted: bool = False) -> None:
        """Complete the output, which then takes its final name.

        Where the export was `interrupted` before the end of its input, a file that appears when it
        is complete takes the name of `partial_name` instead, and so does `name`.
        """

    def rollback(self) -> None:
        """Discard the output: nothing incomplete is left."""


class _File:
    """A file that is open for writing; `way` is that of `_modlens.OutputFile`."""

    remark = ""

    def __init__(self, name: str, path: str, way: str) -> None:
        self.name = name
        try:
            self._file: _modlens.OutputFile | None = _modlens.OutputFile(path, way)
        except OSError as error:
            raise as_source_error(name, error) from error

    def append(self, data: bytes) -> None:
        """Append these bytes; after a failure further bytes are ignored."""
        if self._file is not None:
            self._append(self._file.append, data)

    def append_lines(self, lines: _modlens.Pieces) -> None:
        """Append these lines, of which no bytes are made for Python."""
        if self._file is not None:
            self._append(self._file.append_lines, lines)

    def _append(self, append: Callable[[T], None], what: T) -> None:
        try:
            append(what)
        except OSError as error:
            self.rollback()
            if isinstance(error, BrokenPipeError):
                raise
            raise as_source_error(self.name, error) from error

    def close(self, *, interrupted: bool = False) -> None:
        """Complete the file; does nothing after `rollback`."""
        file, self._file = self._file, None
        if file is None:
            return
        try:
            file.close()
            self._finish()
        except OSError as error:
            self._delete_temporary()
            raise as_source_error(self.name, error) from error

    def rollback(self) -> None:
        """Close and delete the incomplete file, if it is still open."""
        file, self._file = self._file, None
        if file is not None:
            file.discard()
            self._delete_temporary()

    def _finish(self) -> None:
        """Give the complete file its name."""

    def _delete_temporary(self) -> None:
        """Delete the incomplete file."""


class AtomicFile(_File):
    """A file that appears under its name when it is complete, replacing an existing one.

    Special files (a device, a named pipe) are written directly. To open a FIFO waits for its
    reader, until `stopping` is true.
    """

    def __init__(self, path: str, stopping: Callable[[], bool] | None = None) -> None:
        self._path = os.path.realpath(path)
        self._writes_directly = is_special(self._path)
        folder, base = os.path.split(self._path)
        self._temporary_path = os.path.join(folder, f".{base}.{os.getpid()}")
        if self._writes_directly:
            with contextlib.ExitStack() as opened:
                if stopping is not None and is_fifo(self._path):
                    opened.callback(os.close, _opened_with_reader(path, stopping))
                super().__init__(path, self._path, "special")
        else:
            super().__init__(path, self._temporary_path, "whole")

    def close(self, *, interrupted: bool = False) -> None:
        """Rename the file to its name, or beside it where the export was `interrupted`."""
        if interrupted and self._file is not None and not self._writes_directly:
            shown = self._path if os.path.islink(self.name) else self.name
            self.name, self._path = partial_name(shown), partial_name(self._path)
        super().close()

    def _finish(self) -> None:
        if not self._writes_directly:
            os.replace(self._temporary_path, self._path)

    def _delete_temporary(self) -> None:
        if not self._writes_directly:
            with contextlib.suppress(OSError):
                os.unlink(self._temporary_path)


class NewAtomicFile(AtomicFile):
    """A file of a live tap that appears when it is complete, and never replaces an existing one."""

    def __init__(self, path: str) -> None:
        if not is_special(path) and os.path.lexists(path):
            error = FileExistsError(errno.EEXIST, "file exists")
            raise as_source_error(path, error) from error
        super().__init__(path)


class GrowingFile(_File):
    """A new file that grows in place by whole rows, which stay whatever happens later.

    `SourceError` if a file of that name exists.
    """

    def __init__(self, path: str) -> None:
        super().__init__(path, path, "special" if is_special(path) else "growing")


class TappedFifo:
    """A FIFO that a live tap writes: a thread waits for its reader, nothing else does.

    After a signal, which `stopping` reports, what nobody reads is dropped and counted in `remark`.
    """

    def __init__(self, path: str, stopping: Callable[[], bool]) -> None:
        self.name = path
        self.remark = ""
        self._stopping = stopping
        self._pipe = DetachedPipe(path)

    def append(self, data: bytes) -> None:
        """Leave these bytes to the thread; `BrokenPipeError` when the reader has gone."""
        try:
            self._pipe.write(data)
        except BrokenPipeError:
            raise
        except OSError as error:
            raise as_source_error(self.name, error) from error

    def close(self, *, interrupted: bool = False) -> None:
        """Wait for the reader, unless a signal has ended the tap."""
        self._pipe.drain(self._stopping)
        error = self._pipe.take_error()
        if error is not None and not isinstance(error, BrokenPipeError):
            raise as_source_error(self.name, error)
        if unread := self._pipe.dropped + self._pipe.unwritten:
            self.remark = f"{count_of(unread, 'byte')} dropped: nobody read them"

    def rollback(self) -> None:
        """Nothing to do: bytes that were written cannot be taken back."""


class StandardOutput:
    """Standard output, flushed after each `append`; `BrokenPipeError` when its reader has gone.

    A terminal gets no character that could move its cursor or hide text; files and pipes get the
    bytes as they are.
    """

    name = "standard output"
    remark = ""

    def __init__(self) -> None:
        self._is_terminal = sys.stdout.isatty()

    def append(self, data: bytes) -> None:
        """Write these bytes and flush."""
        if self._is_terminal:
            data = for_terminal(data.decode("utf-8", "backslashreplace")).encode()
        try:
            sys.stdout.buffer.write(data)
            sys.stdout.buffer.flush()
        except BrokenPipeError:
            raise
        except OSError as error:
            raise as_source_error(self.name, error) from error

    def close(self, *, interrupted: bool = False) -> None:
        """Nothing to do: every `append` has been flushed."""

    def rollback(self) -> None:
        """Nothing to do: bytes that were written cannot be taken back."""


def open_output(
    path: str | None, *, growing: bool, stopping: Callable[[], bool] | None = None
) -> Output:
    """Open the output of a path; None is standard output. `SourceError` if that fails.

    `stopping` says whether a signal asks the program to end.
    """
    if path is None:
        return StandardOutput()
    if growing and is_fifo(path):
        return TappedFifo(path, stopping or (lambda: False))
    return GrowingFile(path) if growing else AtomicFile(path, stopping)


def append_pieces(output: Output, pieces: Iterable[bytes]) -> None:
    """Append bytes one after the other: lines for a file go there by the shortest way."""
    if isinstance(output, _File) and isinstance(pieces, _modlens.Pieces):
        output.append_lines(pieces)
        return
    for data in pieces:
        if data:
            output.append(data)


def partial_name(path: str) -> str:
    """The name beside `path` for what an interrupted export has decoded.

    >>> partial_name("log.csv")
    'log.csv.partial'
    """
    return f"{path}.partial"


def is_special(path: str) -> bool:
    """Whether a path is a device, a pipe or the like, which must not be replaced by a file."""
    try:
        return not stat.S_ISREG(os.stat(path).st_mode)
    except OSError:
        return False


def is_fifo(path: str) -> bool:
    """Whether a path is a named pipe."""
    with contextlib.suppress(OSError):
        return stat.S_ISFIFO(os.stat(path).st_mode)
    return False


def _opened_with_reader(path: str, stopping: Callable[[], bool]) -> int:
    """A descriptor of a FIFO, as soon as it has a reader; `KeyboardInterrupt` after a signal."""
    while True:
        try:
            return os.open(path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise as_source_error(path, error) from error
        if stopping():
            raise KeyboardInterrupt
        time.sleep(LOOK_S)


def as_source_error(name: str, error: OSError) -> SourceError:
    """The error of a file in words, with what can be done about it."""
    advice = {
        errno.EEXIST: "already exists, and a live tap never overwrites; choose another name",
        errno.ENOSPC: "cannot be written: no space left",
        errno.ENOENT: "cannot be created: its directory does not exist",
        errno.EISDIR: "is a directory; name a file in it",
        errno.EACCES: "no permission to write it",
        errno.EROFS: "cannot be written: the file system is read-only",
    }
    number = error.errno or 0
    if number == errno.EACCES and os.path.isdir(name):
        number = errno.EISDIR  # Windows calls it a matter of permission
    reason = advice.get(number) or f"cannot be written: {error.strerror or error}"
    return SourceError(f"{name}: {reason}")
