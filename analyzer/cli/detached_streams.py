"""Writes standard output and error in threads, so that a tap never waits for their readers.

A terminal may be frozen (Ctrl-S, copy mode of tmux), a pipe may have a reader that has stopped: a
write then blocks for as long as that lasts. Inside the `with` block what is written waits in memory
instead, and everything else goes on. At its end the rest is written; who has sent a signal does not
wait for a reader that takes nothing.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Self, cast

from analyzer.cli.standard_streams import STDERR, STDOUT, report
from analyzer.counts import count_of
from dissectors.errors import SourceError

__all__ = ["DetachedStreams", "write_failure"]

LIMIT_BYTES = 1 << 26
"""Memory of what nobody has read; what is written beyond it is dropped and counted."""

PATIENCE_S = 1.0
"""After a signal, a reader that takes nothing for so long gets no more."""

WRITE_BYTES = 1 << 16


class _Pipe(io.RawIOBase):
    """A binary stream whose bytes a thread writes to a descriptor.

    Errors of the thread are raised by a later `write`, each once.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self.dropped = 0
        self._written = 0
        self._descriptor = descriptor
        self._blocks: deque[bytes] = deque()
        self._size = 0
        self._changed = threading.Condition()
        self._error: OSError | None = None
        thread = threading.Thread(target=self._run, name=f"output {descriptor}", daemon=True)
        thread.start()

    @property
    def is_behind(self) -> bool:
        """Whether something is waiting to be written."""
        return self._size > 0

    def take_error(self) -> OSError | None:
        """The error of the thread that nobody has heard of yet."""
        error, self._error = self._error, None
        return error

    def wait_for_progress(self, seconds: float) -> bool:
        """Whether bytes were written within that time, or none are left."""
        with self._changed:
            before = self._written
            return self._changed.wait_for(
                lambda: self._written != before or not self.is_behind, seconds
            )

    def write(self, data: Any) -> int:
        """Leave bytes to the thread."""
        error = self.take_error()
        if error is not None:
            raise error
        block = bytes(data)
        with self._changed:
            if self._size + len(block) > LIMIT_BYTES:
                self.dropped += len(block)
            elif block:
                self._blocks.append(block)
                self._size += len(block)
                self._changed.notify_all()
        return len(block)

    def writable(self) -> bool:
        """It is."""
        return True

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether the descriptor is that of a terminal."""
        return os.isatty(self._descriptor)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._blocks:
                    self._changed.wait()
                block = b"".join(self._blocks)
                self._blocks.clear()
            self._write_out(memoryview(block))

    def _write_out(self, left: memoryview) -> None:
        """Writes a block in parts; the rest of it is dropped after an error."""
        while left:
            try:
                count = os.write(self._descriptor, left[:WRITE_BYTES])
            except OSError as error:
                self._error = error
                count = len(left)
            left = left[count:]
            with self._changed:
                self._written += count
                self._size -= count
                self._changed.notify_all()


class _DetachedStream(io.TextIOWrapper):
    """A text stream on a `_Pipe`."""

    def __init__(self, descriptor: int, original: Any) -> None:
        self.pipe = _Pipe(descriptor)
        super().__init__(
            cast(Any, self.pipe),
            encoding=original.encoding,
            errors=original.errors,
            newline="\n",
            write_through=True,
        )

    @property
    def is_behind(self) -> bool:
        """Whether something is waiting to be written."""
        return self.pipe.is_behind


class DetachedStreams:
    """Lets threads write both streams inside a `with` block.

    `is_stopping` says whether a signal asks the program to end. `failure` is what the last write to
    standard output has failed with, if nobody has heard of it before.
    """

    def __init__(self, is_stopping: Callable[[], bool]) -> None:
        self.failure: OSError | None = None
        self._is_stopping = is_stopping
        self._originals: list[Any] = []
        self._streams: list[_DetachedStream] = []

    def __enter__(self) -> Self:
        self._originals = [sys.stdout, sys.stderr]
        for stream, descriptor in zip(self._originals, (STDOUT, STDERR), strict=True):
            if not _is_descriptor(stream, descriptor):
                return self
            stream.flush()
        self._streams = [
            _DetachedStream(STDOUT, sys.stdout),
            _DetachedStream(STDERR, sys.stderr),
        ]
        sys.stdout, sys.stderr = self._streams
        return self

    def __exit__(self, *error: object) -> None:
        if not self._streams:
            return
        self._drain()
        sys.stdout, sys.stderr = self._originals
        out, err = (stream.pipe for stream in self._streams)
        self.failure = out.take_error()
        if out.dropped and not err.is_behind:
            report(f"modlens: {count_of(out.dropped, 'byte')} of output dropped: nobody read them")

    def _drain(self) -> None:
        """Wait until everything is written, or nothing more is to be expected."""
        for stream in self._streams:
            while stream.pipe.is_behind:
                if not stream.pipe.wait_for_progress(PATIENCE_S) and self._is_stopping():
                    break


def _is_descriptor(stream: Any, descriptor: int) -> bool:
    """Whether a stream is the system's; a test may have put another in its place."""
    with contextlib.suppress(OSError, AttributeError, ValueError):
        return int(stream.fileno()) == descriptor
    return False


def write_failure(error: OSError) -> SourceError | None:
    """What to tell of an error of standard output; nothing where its reader has gone."""
    if isinstance(error, BrokenPipeError):
        return None
    return SourceError(f"standard output: cannot be written: {error.strerror}")
