r"""The terminal, or what stands in its place: width, colour, and no control characters but our own.

Texts from recordings are hostile until shown otherwise: a device name may hold the escape sequence
that clears the screen. Everything that is printed goes through `visible`.

>>> visible("pump\x1b[2J")
'pump\\x1b[2J'
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import NoReturn, TextIO

from rich.cells import cell_len, set_cell_size
from rich.console import Console
from rich.control import Control
from rich.segment import ControlType, Segment, Segments
from rich.style import Style

from dissectors.errors import SourceError

__all__ = ["Part", "Screen", "fit", "visible", "width_of"]

Part = tuple[str, str]
"""A text and the name of its style in `STYLES`; "" is none."""

STYLES = {
    "head": Style(bold=True),
    "dim": Style(dim=True),
    "good": Style(color="green"),
    "odd": Style(color="yellow"),
    "bad": Style(color="red", bold=True),
    "note": Style(color="cyan"),
}

_CLEAR_REST = Control((ControlType.ERASE_IN_LINE, 0)).segment

_SHOWN = {
    code: ascii(chr(code))[1:-1]
    for code in (
        *range(0x20),
        *range(0x7F, 0xA0),
        0xAD,  # a soft hyphen
        *range(0x200B, 0x2010),  # invisible marks of direction
        *range(0x2028, 0x202F),
        *range(0x2066, 0x206A),
        *range(0xD800, 0xE000),  # what file names hold that are no text
        0xFEFF,
    )
}


def visible(text: str) -> str:
    """The text with everything that could move the cursor or hide letters spelled out."""
    return text if text.isascii() and text.isprintable() else text.translate(_SHOWN)


def width_of(text: str) -> int:
    """Columns of the terminal that a text takes."""
    return len(text) if text.isascii() else cell_len(text)


def fit(text: str, width: int, *, right: bool = False) -> str:
    """The text in exactly `width` columns, cut with an ellipsis or filled with spaces.

    >>> fit("holding", 5), fit("ok", 4), fit("ok", 4, right=True)
    ('hold…', 'ok  ', '  ok')
    """
    length = width_of(text)
    if length > width:
        return set_cell_size(text, max(width - 1, 0)) + ("…" if width > 0 else "")
    gap = " " * (width - length)
    return gap + text if right else text + gap


def _unwritten(error: OSError) -> SourceError:
    return SourceError(f"standard output: cannot be written: {error.strerror}")


@contextlib.contextmanager
def _written() -> Iterator[None]:
    """What the system says against writing, as `SourceError`; `BrokenPipeError` as it is."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _unwritten(error) from error


def _cut(line: Iterable[Part], width: int) -> Iterator[Part]:
    """As much of a line as there is room for."""
    for text, style in line:
        taken = width_of(text)
        if taken > width:
            yield fit(text, width), style
            return
        width -= taken
        yield text, style


class _Terminal(Console):
    """rich ends the process when the reader of a pipe goes away; here the caller decides."""

    def on_broken_pipe(self) -> NoReturn:
        raise BrokenPipeError


class Screen:
    """One stream to print to.

    Colour only on a terminal, and not under `NO_COLOR` (rich sees to both); `is_plain` where there
    is none. `width` is for what is no terminal.
    """

    def __init__(self, stream: TextIO, *, width: int | None = None) -> None:
        self._stream = stream
        self._console = _Terminal(
            file=stream, width=width, highlight=False, markup=False, emoji=False
        )
        self.is_plain = not self._console.is_terminal or self._console.color_system is None

    @property
    def is_terminal(self) -> bool:
        """Whether somebody looks at it."""
        return self._console.is_terminal

    @property
    def width(self) -> int:
        """Columns: the terminal's, else those of `COLUMNS`, else 80."""
        return self._console.width

    def lines(self, lines: Iterable[Iterable[Part]]) -> None:
        """Print lines of parts, flushed once at the end.

        `BrokenPipeError` when nobody reads, `SourceError` when they cannot be written.
        """
        if self.is_plain:
            self.text("".join("".join(text for text, _ in line).rstrip() + "\n" for line in lines))
            return
        segments = []
        for line in lines:
            segments += [Segment(text, STYLES.get(style)) for text, style in line]
            segments.append(Segment.line())
        with _written():
            self._console.print(Segments(segments), end="", soft_wrap=True)
            self._stream.flush()

    def text(self, lines: str) -> None:
        """Print whole lines without styles, made visible before; errors as those of `lines`."""
        try:  # a live tap comes here for each transaction: a context manager costs as much as this
            self._stream.write(lines)
            self._stream.flush()
        except BrokenPipeError:
            raise
        except OSError as error:
            raise _unwritten(error) from error

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines of the terminal as it is now."""
        return self._console.size.width, self._console.size.height

    def begin_pages(self) -> None:
        """Leave what is on the terminal alone: pages are drawn on a screen of their own."""
        self._console.set_alt_screen(True)
        self._console.show_cursor(False)

    def end_pages(self) -> None:
        """Show again what was there before."""
        self._console.show_cursor(True)
        self._console.set_alt_screen(False)

    def page(self, lines: Sequence[Iterable[Part]]) -> None:
        """Draw lines over the ones before, each to the edge of the terminal and not beyond."""
        segments, width = [Control.home().segment], self.size[0]
        for number, line in enumerate(lines):
            segments += [Segment(text, STYLES.get(style)) for text, style in _cut(line, width)]
            segments.append(_CLEAR_REST)
            if number < len(lines) - 1:
                segments.append(Segment.line())
        self._console.print(Segments(segments), end="", soft_wrap=True)

    def line(self, text: str, style: str = "") -> None:
        """Print one line."""
        self.lines([[(text, style)]])


def stdout() -> Screen:
    """Standard output as it is now."""
    return Screen(sys.stdout)
