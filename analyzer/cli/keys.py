"""Reads keys from the terminal one at a time, without waiting for them or for Enter.

The terminal's settings are restored when the `with` block ends. On Windows, which has no termios,
the console is asked instead. Where standard input is not a terminal there are no keys.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
from types import TracebackType
from typing import Any, Self

__all__ = ["Keys"]


class Keys:
    """A keyboard that can be polled; use it in `with`."""

    def __init__(self) -> None:
        self._fd = -1
        self._saved_attributes: list[Any] | None = None

    def pressed(self) -> str:
        """The characters typed since the last call; escape sequences (arrow keys) are dropped."""
        if self._saved_attributes is None:
            return _windows_console_keys() if os.name == "nt" else ""
        text = ""
        while select.select([self._fd], [], [], 0)[0]:
            data = os.read(self._fd, 256)
            if not data:
                self._saved_attributes = None
                break
            text += data.decode("utf-8", "ignore")
        return "" if text.startswith("\x1b") and len(text) > 1 else text

    def __enter__(self) -> Self:
        with contextlib.suppress(ImportError, OSError, ValueError):
            import termios  # noqa: PLC0415
            import tty  # noqa: PLC0415

            self._fd = sys.stdin.fileno()
            if os.isatty(self._fd):
                self._saved_attributes = termios.tcgetattr(self._fd)
                tty.setcbreak(self._fd)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._saved_attributes is not None:
            import termios  # noqa: PLC0415

            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(self._fd, termios.TCSADRAIN, self._saved_attributes)


def _windows_console_keys() -> str:
    import msvcrt  # noqa: PLC0415

    console: Any = msvcrt
    text = ""
    while console.kbhit():
        text += console.getwch()
    return text
