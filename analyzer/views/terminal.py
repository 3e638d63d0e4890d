"""A terminal by means of rich: styles, size, and pages drawn over each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NoReturn, TextIO

from rich.console import Console
from rich.control import Control
from rich.segment import ControlType, Segment, Segments
from rich.style import Style

__all__ = ["STYLES", "Terminal"]

STYLES = {
    "head": Style(bold=True),
    "dim": Style(dim=True),
    "good": Style(color="green"),
    "odd": Style(color="yellow"),
    "bad": Style(color="red", bold=True),
    "note": Style(color="cyan"),
}

_CLEAR_REST = Control((ControlType.ERASE_IN_LINE, 0)).segment


class Terminal(Console):
    """A stream that is a terminal, or is treated as one (`FORCE_COLOR`)."""

    def __init__(self, stream: TextIO, width: int | None) -> None:
        super().__init__(file=stream, width=width, highlight=False, markup=False, emoji=False)

    @property
    def is_plain(self) -> bool:
        """Whether it shows no colour."""
        return not self.is_terminal or self.color_system is None

    def on_broken_pipe(self) -> NoReturn:
        """Raise `BrokenPipeError`; rich would end the process, here the caller decides."""
        raise BrokenPipeError

    def lines(self, lines: Iterable[Iterable[tuple[str, str]]]) -> None:
        """Print lines of texts with the names of their styles."""
        segments = []
        for line in lines:
            segments += [Segment(text, STYLES.get(style)) for text, style in line]
            segments.append(Segment.line())
        self.print(Segments(segments), end="", soft_wrap=True)

    def begin_pages(self) -> None:
        """Switch to the alternate screen and hide the cursor."""
        self.set_alt_screen(True)
        self.show_cursor(False)

    def end_pages(self) -> None:
        """Switch back to the normal screen and show the cursor."""
        self.show_cursor(True)
        self.set_alt_screen(False)

    def page(self, lines: Sequence[Iterable[tuple[str, str]]]) -> None:
        """Draw a page over the one before."""
        segments = [Control.home().segment]
        for number, line in enumerate(lines):
            segments += [Segment(text, STYLES.get(style)) for text, style in line]
            segments.append(_CLEAR_REST)
            if number < len(lines) - 1:
                segments.append(Segment.line())
        self.print(Segments(segments), end="", soft_wrap=True)
