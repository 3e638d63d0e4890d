"""A pager for what is longer than the screen: `$PAGER`, or less.

While it is in use, standard output and standard error lead to it, as with git. Its reader may leave
at any time, which ends the command as a closed pipe does.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO, cast

from analyzer.cli.standard_streams import STDERR, STDOUT, discard_output

if TYPE_CHECKING:
    import subprocess

__all__ = ["PAGED", "paged", "wants_pager"]

PAGED = (
    "decode", "show", "doctor", "stats", "explain", "formats", "profiles", "map", "learn", "match",
    "find",
)  # fmt: skip
"""The commands whose output is read by people, from its beginning."""

_LESS = "FRX"
"""Leave at once what fits on the screen, show colours, and leave the text there at the end."""


def wants_pager(command: str, options: argparse.Namespace) -> bool:
    """Whether a command's output may go to a pager.

    Not where the rows come as somebody writes them: from a pipe, or from a file that grows.
    """
    if command not in PAGED or options.no_pager or getattr(options, "follow", False):
        return False
    return "-" not in getattr(options, "files", ())


@contextlib.contextmanager
def paged(*, wanted: bool) -> Iterator[None]:
    """Send what is printed inside the `with` block through the pager, where there is one.

    It is started by the first character on standard output, so that a command can show until then
    how far it is. Nothing changes unless standard output is a terminal.
    """
    words = _pager() if wanted and sys.stdout.isatty() else []
    if not words:
        yield
        return
    pager = _Pager(words)
    streams = sys.stdout, sys.stderr
    sys.stdout = cast(TextIO, _Terminal(sys.stdout, pager.start))
    if sys.stderr.isatty():
        sys.stderr = cast(TextIO, _Terminal(sys.stderr, lambda: None))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams
        pager.close()


class _Terminal:
    """A stream that is a terminal, even when a pager has come between; writing calls `on_write`."""

    def __init__(self, stream: TextIO, on_write: Callable[[], None]) -> None:
        self._stream = stream
        self._on_write = on_write

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self._on_write()
        return self._stream.write(text)

    def writelines(self, lines: Iterable[str]) -> None:
        self._on_write()
        self._stream.writelines(lines)

    @property
    def buffer(self) -> BinaryIO:
        self._on_write()
        return self._stream.buffer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class _Pager:
    """The pager's process, and the descriptors of the terminal that lead to it meanwhile."""

    def __init__(self, words: list[str]) -> None:
        self._words = words
        self._process: subprocess.Popen[bytes] | None = None
        self._has_failed = False
        self._streams = {STDOUT: sys.stdout, STDERR: sys.stderr}
        self._terminals: dict[int, int] = {}

    def start(self) -> None:
        """Start it, if that has not been tried yet, and connect the output to it."""
        if self._process is not None or self._has_failed:
            return
        import subprocess  # noqa: PLC0415 - where there is a terminal only

        env = {"LESS": _LESS, "LV": "-c", **os.environ}
        try:
            self._process = subprocess.Popen(self._words, stdin=subprocess.PIPE, env=env)
        except OSError:
            self._has_failed = True
            return
        pipe = self._process.stdin
        if pipe is None:
            return
        for number, stream in self._streams.items():
            if stream.isatty():
                stream.flush()
                self._terminals[number] = os.dup(number)
                os.dup2(pipe.fileno(), number)
        pipe.close()

    def close(self) -> None:
        """Give the terminal back to the output when the reader has left."""
        for number, terminal in self._terminals.items():
            stream = self._streams[number]
            try:
                stream.flush()
            except OSError:
                discard_output(number)
                with contextlib.suppress(OSError):
                    stream.flush()
            os.dup2(terminal, number)
            os.close(terminal)
        while self._process is not None:
            # Ctrl-C is a key of the pager, and ends nothing but what it is doing.
            with contextlib.suppress(KeyboardInterrupt):
                self._process.wait()
                return


def _pager() -> list[str]:
    """The words that start the pager; none where there is none or it would show all at once."""
    if os.environ.get("TERM", "dumb") == "dumb":
        return []
    import shlex  # noqa: PLC0415 - where there is a terminal only
    import shutil  # noqa: PLC0415

    words = shlex.split(os.environ.get("MODLENS_PAGER", os.environ.get("PAGER", "less")))
    if not words or words[0] == "cat" or shutil.which(words[0]) is None:
        return []
    return words
