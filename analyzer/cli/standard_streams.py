"""Standard output and standard error as file descriptors, and what to do when nobody reads them."""

from __future__ import annotations

import os

__all__ = ["STDERR", "STDOUT", "discard_output"]

STDOUT, STDERR = 1, 2


def discard_output(descriptor: int) -> None:
    """Redirect a descriptor whose reader has gone to the null device.

    What is left in Python's buffer is dropped there, too; without that the interpreter would fail
    again when it flushes its streams at its end.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)
