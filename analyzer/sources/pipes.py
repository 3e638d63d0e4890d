"""Pipes and FIFOs: opened without waiting for a writer, and watched so that a signal can end it."""

from __future__ import annotations

import io
import os
import select
import stat
from contextlib import suppress

__all__ = ["STDIN", "WAIT_S", "FirstBytes", "has_bytes", "open_unbuffered"]

STDIN = "-"
"""The name that means standard input."""

WAIT_S = 0.1
"""Seconds to wait for a pipe before an empty block says that nothing has come."""


def open_unbuffered(name: str) -> io.FileIO:
    """A file, FIFO or standard input, unbuffered; opening a FIFO does not wait for its writer."""
    if name == STDIN:
        return open(0, "rb", buffering=0, closefd=False)
    if stat.S_ISFIFO(os.stat(name).st_mode):
        return open(os.open(name, os.O_RDONLY | os.O_NONBLOCK), "rb", buffering=0)
    return open(name, "rb", buffering=0)


def has_bytes(file: int | io.FileIO) -> bool:
    """Whether something can be read, or the end has come; waits `WAIT_S` for it."""
    return bool(select.select([file], [], [], WAIT_S)[0])


class FirstBytes:
    """Waits for the first bytes of a pipe or FIFO, so that its reader can be stopped meanwhile.

    Files that are no pipes have come at once. Use it in `with`, and open the recording within it:
    a FIFO forgets what was written when nobody has it open.
    """

    def __init__(self, name: str) -> None:
        self._descriptor: int | None = None
        self._is_ours = False
        with suppress(OSError, ValueError):  # the one who reads it says what is wrong
            if name == STDIN:
                self._descriptor = 0
            elif stat.S_ISFIFO(os.stat(name).st_mode):
                self._descriptor = os.open(name, os.O_RDONLY | os.O_NONBLOCK)
                self._is_ours = True

    def have_come(self) -> bool:
        """Whether reading would give something, or the end."""
        if self._descriptor is None or os.name != "posix":
            return True
        try:
            return has_bytes(self._descriptor)
        except (OSError, ValueError):
            return True

    def __enter__(self) -> FirstBytes:
        return self

    def __exit__(self, *error: object) -> None:
        if self._is_ours and self._descriptor is not None:
            os.close(self._descriptor)
