"""The three standard streams as file descriptors, and what to do when they lead nowhere."""

from __future__ import annotations

import os
import sys

from analyzer.visible import for_terminal, visible

__all__ = ["STDERR", "STDOUT", "discard_output", "open_missing_streams", "print_text", "report"]

STDIN, STDOUT, STDERR = 0, 1, 2


def discard_output(descriptor: int) -> None:
    """Redirect a descriptor whose reader has gone to the null device.

    What is left in Python's buffer is also dropped there; without that the interpreter would fail
    again when it flushes its streams at its end.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)


def open_missing_streams() -> None:
    """Give the null device to streams that the caller has closed (`2>&-`).

    Otherwise the next file that is opened would get the descriptor, and messages would go into it.
    Writing to a closed standard output stays an error; messages to a closed standard error are
    dropped.
    """
    for descriptor, name in ((STDIN, "stdin"), (STDOUT, "stdout"), (STDERR, "stderr")):
        if getattr(sys, name) is not None:
            continue
        null = os.open(os.devnull, os.O_WRONLY if descriptor == STDERR else os.O_RDONLY)
        if null != descriptor:
            os.dup2(null, descriptor)
            os.close(null)
        mode = "r" if descriptor == STDIN else "w"
        stream = os.fdopen(descriptor, mode, encoding="utf-8", closefd=False)
        setattr(sys, name, stream)


def report(line: str) -> None:
    """Write one line to standard error; it is dropped when nobody reads."""
    try:
        sys.stderr.write(f"{visible(line)}\n")
        sys.stderr.flush()
    except OSError:
        discard_output(STDERR)


def print_text(text: str) -> None:
    """Write lines of text to standard output, escaped if that is a terminal."""
    sys.stdout.write(for_terminal(text) if sys.stdout.isatty() else text)
