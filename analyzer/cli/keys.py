"""Reads keys from the terminal one at a time, without waiting for them or for Enter.

The terminal's settings are restored when the `with` block ends. On Windows, which has no termios,
the console is asked instead. Where standard input is not a terminal there are no keys.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
from types import TracebackType
from typing import Any, Self

__all__ = ["Keys"]

_KEY = re.compile(r"\x1b(?:\[[0-9;]*[A-Za-z~]|O[A-Za-z])|.", re.DOTALL)
"""A character, or the sequence of a key that has none (ECMA-48 CSI, and SS3 of VT100s)."""

_NAMES = {
    "\x1b[A": "Up", "\x1bOA": "Up",
    "\x1b[B": "Down", "\x1bOB": "Down",
    "\x1b[5~": "PageUp",
    "\x1b[6~": "PageDown",
    "\x1b[H": "Home", "\x1bOH": "Home", "\x1b[1~": "Home", "\x1b[7~": "Home",
    "\x1b[F": "End", "\x1bOF": "End", "\x1b[4~": "End", "\x1b[8~": "End",
}  # fmt: skip
_WINDOWS_NAMES = {"H": "Up", "P": "Down", "I": "PageUp", "Q": "PageDown", "G": "Home", "O": "End"}
"""What follows the prefix that the console gives for a key without a character."""


class Keys:
    """A keyboard that can be polled; use it in `with`."""

    def __init__(self) -> None:
        self._fd = -1
        self._saved_attributes: list[Any] | None = None

    def pressed(self) -> list[str]:
        """The keys typed since the last call: characters, and `Up`, `PageDown` and the like.

        Other keys without a character are left out.
        """
        if self._saved_attributes is None:
            return _windows_console_keys() if os.name == "nt" else []
        text = ""
        while select.select([self._fd], [], [], 0)[0]:
            data = os.read(self._fd, 256)
            if not data:
                self._saved_attributes = None
                break
            text += data.decode("utf-8", "ignore")
        return _keys_of(text)

    def __enter__(self) -> Self:
        with contextlib.suppress(ImportError, OSError, ValueError):
            import termios  # noqa: PLC0415
            import tty  # noqa: PLC0415

            self._fd = sys.stdin.fileno()
            if os.isatty(self._fd):
                self._saved_attributes = termios.tcgetattr(self._fd)
                # TCSANOW does not wait for what a frozen terminal has still to show.
                tty.setcbreak(self._fd, termios.TCSANOW)
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
                termios.tcsetattr(self._fd, termios.TCSANOW, self._saved_attributes)


def _keys_of(text: str) -> list[str]:
    r"""The keys in what a terminal has sent.

    >>> _keys_of("a\x1b[5~\x1b[A\x1b[15~q"), _keys_of("\x1b")
    (['a', 'PageUp', 'Up', 'q'], ['\x1b'])
    """
    found = _KEY.findall(text)
    return [_NAMES.get(key, key) for key in found if len(key) == 1 or key in _NAMES]


def _windows_console_keys() -> list[str]:
    import msvcrt  # noqa: PLC0415

    console: Any = msvcrt
    keys = []
    while console.kbhit():
        key = console.getwch()
        if key in "\x00\xe0":
            key = _WINDOWS_NAMES.get(console.getwch(), "")
        keys.append(key)
    return [key for key in keys if key]
