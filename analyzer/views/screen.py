"""Output to a terminal, file or pipe: width, colour, and no control characters but our own.

Everything that is printed goes through `analyzer.visible`; texts that are escaped already stay as
they are.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, TextIO

from analyzer.visible import for_terminal, visible
from dissectors.errors import SourceError

if TYPE_CHECKING:
    from analyzer.views.terminal import Terminal

__all__ = ["Part", "Screen", "fit", "visible", "width_of"]

Part = tuple[str, str]
"""A text and the name of its style in `terminal.STYLES`; "" for no style."""

DEFAULT_COLUMNS = 80
"""Width where the terminal's is not known."""


def width_of(text: str) -> int:
    """The number of terminal columns that a text takes."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len  # noqa: PLC0415 - rich is loaded where it is needed only

    return cell_len(text)


def fit(text: str, width: int, *, right: bool = False) -> str:
    """Cut a text with an ellipsis, or pad it with spaces, to exactly `width` columns.

    >>> fit("holding", 5), fit("ok", 4), fit("ok", 4, right=True)
    ('hold…', 'ok  ', '  ok')
    """
    length = width_of(text)
    if length > width:
        return _truncated(text, max(width - 1, 0)) + ("…" if width > 0 else "")
    gap = " " * (width - length)
    return gap + text if right else text + gap


def _truncated(text: str, width: int) -> str:
    if text.isascii():
        return text[:width]
    from rich.cells import set_cell_size  # noqa: PLC0415 - as above

    return set_cell_size(text, width)


def _write_error(error: OSError) -> SourceError:
    return SourceError(f"standard output: cannot be written: {error.strerror}")


@contextlib.contextmanager
def _as_source_error() -> Iterator[None]:
    """Raise errors of writing as `SourceError`; `BrokenPipeError` stays what it is."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _write_error(error) from error


def _visible_parts(line: Iterable[Part]) -> Iterator[Part]:
    """The parts of a line as a terminal may get them."""
    return ((visible(text), style) for text, style in line)


def _truncate(line: Iterable[Part], width: int) -> Iterator[Part]:
    """The parts of a line that fit into `width` columns."""
    for text, style in line:
        taken = width_of(text)
        if taken > width:
            yield fit(text, width), style
            return
        width -= taken
        yield text, style


class Screen:
    """A stream to print to.

    Colour is used only on a terminal and not under `NO_COLOR` (rich decides that); `is_plain` is
    True where there is none. `width` is the width where the stream is not a terminal.
    """

    def __init__(self, stream: TextIO, *, width: int | None = None) -> None:
        self._stream = stream
        self._width = width
        self._terminal: Terminal | None = None
        forced = os.environ.keys() & {"FORCE_COLOR", "TTY_COMPATIBLE"}
        self.is_plain = not (stream.isatty() or forced) or self._rich().is_plain

    def _rich(self) -> Terminal:
        if self._terminal is None:
            # Importing rich takes a third of a command's start-up, and most output goes to files
            # and pipes.
            from analyzer.views.terminal import Terminal  # noqa: PLC0415

            self._terminal = Terminal(self._stream, self._width)
        return self._terminal

    @property
    def is_terminal(self) -> bool:
        """Whether the stream is a terminal."""
        return self._terminal is not None and self._terminal.is_terminal

    @property
    def is_dumb(self) -> bool:
        """Whether the terminal knows no control sequences (`TERM=dumb`, or not set)."""
        return self._terminal is not None and self._terminal.is_dumb_terminal

    @property
    def is_behind(self) -> bool:
        """Whether the terminal has not taken yet what was printed before."""
        return bool(getattr(self._stream, "is_behind", False))

    @property
    def width(self) -> int:
        """Columns: the terminal's, else those of `DEFAULT_COLUMNS`, else 80."""
        if self._terminal is not None:
            return self._terminal.width
        columns = os.environ.get("COLUMNS", "")
        notify = int(columns) if columns.isdecimal() else 0
        return self._width or notify or _columns()

    def lines(self, lines: Iterable[Iterable[Part]]) -> None:
        """Print lines of parts, flushed once at the end.

        `BrokenPipeError` when nobody reads, `SourceError` when they cannot be written.
        """
        if self.is_plain:
            self.text("".join("".join(text for text, _ in line).rstrip() + "\n" for line in lines))
            return
        with _as_source_error():
            self._rich().lines(map(_visible_parts, lines))
            self._stream.flush()

    def text(self, lines: str) -> None:
        """Print whole lines without styles; raises as `lines` does."""
        lines = for_terminal(lines)
        # A live tap calls this for each transaction, and a context manager would double its cost.
        try:
            self._stream.write(lines)
            self._stream.flush()
        except BrokenPipeError:
            raise
        except OSError as error:
            raise _write_error(error) from error

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines of the terminal as it is now."""
        size = self._rich().size
        return size.width, size.height

    def begin_pages(self) -> None:
        """Switch to the terminal's alternate screen, on which pages are drawn."""
        self._rich().begin_pages()

    def end_pages(self) -> None:
        """Switch back to the terminal's normal screen."""
        self._rich().end_pages()

    def page(self, lines: Sequence[Iterable[Part]]) -> None:
        """Draw a page over the one before; lines are cut off at the edge of the terminal."""
        width = self.size[0]
        self._rich().page([list(_truncate(_visible_parts(line), width)) for line in lines])

    def line(self, text: str, style: str = "") -> None:
        """Print one line."""
        self.lines([[(text, style)]])


def _columns() -> int:
    """The width of the terminal that any of the three standard streams is connected to."""
    for descriptor in range(3):
        with contextlib.suppress(OSError):
            return os.get_terminal_size(descriptor).columns or DEFAULT_COLUMNS
    return DEFAULT_COLUMNS


def stdout() -> Screen:
    """A screen on the present standard output."""
    return Screen(sys.stdout)
