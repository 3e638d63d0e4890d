"""Ctrl-C, SIGTERM and SIGHUP ask the program to complete its outputs and end.

A second signal ends it at once. The handlers only set a flag, so that no output is cut in the
middle of a row: the loop that reads the input checks `received` between blocks.
"""

from __future__ import annotations

import contextlib
import os
import signal
from types import FrameType
from typing import Self

__all__ = ["StopSignals"]

_STDIN, _STDERR = 0, 2
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has no SIGHUP


class StopSignals:
    """Catches the signals inside a `with` block; `signal` is the number of the last one."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._previous_handlers: dict[int, object] = {}

    def received(self) -> bool:
        """Whether a signal has been received."""
        return self.signal is not None

    def __enter__(self) -> Self:
        for name in _NAMES:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                self._previous_handlers[number] = signal.signal(number, self._remember)
        return self

    def __exit__(self, *error: object) -> None:
        self._restore()

    def _remember(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        self._restore()
        if number == signal.SIGINT:
            _end_echoed_line()

    def _restore(self) -> None:
        for number, handler in self._previous_handlers.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self._previous_handlers.clear()


def _end_echoed_line() -> None:
    """Ends the line in which the terminal has echoed ^C, so that what follows begins its own."""
    try:
        import termios  # noqa: PLC0415 - Windows has none
    except ImportError:
        return
    # `termios.error` is no `OSError`. Standard input may be a file, or closed.
    with contextlib.suppress(termios.error, OSError):
        flags = termios.tcgetattr(_STDIN)[3]
        if flags & termios.ECHO and flags & termios.ECHOCTL and os.isatty(_STDERR):
            os.write(_STDERR, b"\n")
