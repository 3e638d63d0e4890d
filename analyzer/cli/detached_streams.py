"""Writes standard output and error in threads, so that a tap never waits for their readers.

A terminal may be frozen (Ctrl-S, copy mode of tmux), a pipe may have a reader that has stopped: a
write then blocks for as long as that lasts. Inside the `with` block what is written waits in memory
instead, and everything else goes on. At its end the rest is written; who has sent a signal does not
wait for a reader that takes nothing.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable
from typing import Any, Self, cast

from analyzer.cli.standard_streams import STDERR, STDOUT, report
from analyzer.counts import count_of
from analyzer.exports.detached_pipe import DetachedPipe
from dissectors.errors import SourceError

__all__ = ["DetachedStreams", "write_failure"]


class _DetachedStream(io.TextIOWrapper):
    """A text stream on a `DetachedPipe`."""

    def __init__(self, descriptor: int, original: Any) -> None:
        self.pipe = DetachedPipe(descriptor)
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
            stream.pipe.drain(self._is_stopping)


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
