"""A pipe that a thread writes, so that a tap never waits for its reader.

A pipe may have a reader that has stopped, a FIFO none at all. What is written waits in memory; what
does not fit there is dropped and counted.
"""

from __future__ import annotations

import io
import os
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

__all__ = ["DetachedPipe"]

LIMIT_BYTES = 1 << 26
"""Memory of what nobody has read; what is written beyond it is dropped and counted."""

PATIENCE_S = 1.0
"""After a signal, a reader that takes nothing for so long gets no more."""

WRITE_BYTES = 1 << 16


class DetachedPipe(io.RawIOBase):
    """A binary stream whose bytes a thread writes.

    `target` is a descriptor, or the path of a FIFO, which the thread opens as soon as it has a
    reader. Errors of the thread are raised by a later `write`, each once.
    """

    def __init__(self, target: int | str) -> None:
        super().__init__()
        self.dropped = 0
        self._written = 0
        self._target = target
        self._blocks: deque[bytes] = deque()
        self._size = 0
        self._changed = threading.Condition()
        self._error: OSError | None = None
        thread = threading.Thread(target=self._run, name=f"output {target}", daemon=True)
        thread.start()

    @property
    def is_behind(self) -> bool:
        """Whether something is waiting to be written."""
        return self._size > 0

    @property
    def unwritten(self) -> int:
        """How many bytes are waiting to be written."""
        return self._size

    def take_error(self) -> OSError | None:
        """The error of the thread that nobody has heard of yet."""
        error, self._error = self._error, None
        return error

    def drain(self, is_stopping: Callable[[], bool]) -> None:
        """Wait until everything is written, or, after a signal, no more is read."""
        while self.is_behind:
            if not self._wait_for_progress(PATIENCE_S) and is_stopping():
                break

    def _wait_for_progress(self, seconds: float) -> bool:
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
        if isinstance(self._target, str):
            raise io.UnsupportedOperation("opened by another thread")
        return self._target

    def isatty(self) -> bool:
        """Whether the descriptor is that of a terminal."""
        return isinstance(self._target, int) and os.isatty(self._target)

    def _run(self) -> None:
        descriptor = self._target
        if isinstance(descriptor, str):
            try:
                descriptor = os.open(descriptor, os.O_WRONLY)
            except OSError as error:
                self._error = error
                descriptor = -1
        while True:
            with self._changed:
                while not self._blocks:
                    self._changed.wait()
                block = b"".join(self._blocks)
                self._blocks.clear()
            self._write_out(descriptor, memoryview(block))

    def _write_out(self, descriptor: int, left: memoryview) -> None:
        """Writes a block in parts; the rest of it is dropped after an error."""
        while left:
            try:
                count = os.write(descriptor, left[:WRITE_BYTES])
            except OSError as error:
                self._error = error
                count = len(left)
            left = left[count:]
            with self._changed:
                self._written += count
                self._size -= count
                self._changed.notify_all()
