"""The live screens of `modlens tap --view`: draws them, and obeys the keys.

A sink like others, so it is asked after each batch; it draws five times a second at most.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

import _modlens
from analyzer.cli.keys import Keys
from analyzer.filters import parse
from analyzer.views.live import VIEWS, draw
from analyzer.views.live.state import Board
from analyzer.views.screen import Part, Screen, fit, visible
from dissectors.errors import FilterError

__all__ = ["Cockpit"]

REFRESH_S = 0.2
_HELP = "l log t table m map h health  p pause / filter k mark q quit"


class Cockpit:
    """Shows `board` on the terminal, beginning with the view of that name; used by `with`.

    `leaving` is True when somebody pressed q. Notes of the tap (`say`) are shown at the bottom and
    kept in `said`, because they would spoil the screen.
    """

    name = "the screen"
    table = ""

    def __init__(self, board: Board, view: str, screen: Screen) -> None:
        self.leaving = False
        self.said: list[str] = []
        self.rows = 0
        self._board = board
        self._view = view
        self._screen = screen
        self._keys = Keys()
        self._drawn = float("-inf")
        self._typing: str | None = None
        self._note = ""
        self._top = 0
        self._commands: dict[str, Callable[[], None]] = {
            "q": self._quit,
            "\x03": self._quit,
            "p": self._pause,
            " ": self._pause,
            "k": self._mark,
            "/": self._ask,
            "n": lambda: self._turn(1),
            "b": lambda: self._turn(-1),
        }

    def put(self, batch: _modlens.Batch) -> None:
        """Take what was decided, look at the keys, draw if it is time."""
        self._board.put(batch)
        keys = self._keys.typed()
        for key in keys:
            self._press(key)
        if keys or time.monotonic() - self._drawn >= REFRESH_S:
            self.draw()

    def say(self, text: str) -> None:
        """A note of the tap."""
        self.said.append(text)
        self._note = text

    def draw(self) -> None:
        """The whole screen, now."""
        self._drawn = time.monotonic()
        self._board.refresh()
        width, height = self._screen.size
        room = max(height - 2, 1)
        body = draw(self._view, self._board, width, room)
        self._top = max(min(self._top, len(body) - room), 0)
        shown = body[self._top : self._top + room]
        pages = f" {self._top + 1}-{self._top + len(shown)} of {len(body)}, n next b back"
        foot = self._foot(width, pages if len(body) > room else "")
        self._screen.page([self._title(width), *shown, *[[]] * (room - len(shown)), foot])

    def close(self) -> None:
        """Nothing to do: what was drawn is drawn."""

    def abandon(self) -> None:
        """Nothing to do."""

    def __enter__(self) -> Self:
        self._keys.__enter__()
        self._screen.begin_pages()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._screen.end_pages()
        self._keys.__exit__(kind, error, traceback)

    def _title(self, width: int) -> list[Part]:
        buses = ", ".join(visible(bus) for bus in self._board.look.buses)
        state = " PAUSED" if self._board.paused else ""
        elapsed = int(self._board.elapsed)
        clock = f"{elapsed // 3600}:{elapsed // 60 % 60:02d}:{elapsed % 60:02d}"
        right = f" {self._board.seen:,} transactions  {clock}{state}"
        left = f"modlens {self._view}  {buses}"
        return [(fit(left, max(width - len(right), 0)), "head"), (right[-width:], "head")]

    def _foot(self, width: int, pages: str) -> list[Part]:
        if self._typing is not None:
            return [(fit(f"filter: {visible(self._typing)}_", width), "note")]
        if self._note:
            return [(fit(visible(self._note), width), "odd")]
        shown = f"filter: {self._board.filter}  " if self._board.filter else ""
        left = fit(f"{visible(shown)}{_HELP}", max(width - len(pages), 0))
        return [(left, "dim"), (pages[-width:], "note")]

    def _press(self, key: str) -> None:
        self._note = ""
        if self._typing is not None:
            self._type(key)
        elif key in self._commands:
            self._commands[key]()
        else:
            chosen = [name for name, view in VIEWS.items() if view.key == key]
            if chosen:
                self._view, self._top = chosen[0], 0

    def _type(self, key: str) -> None:
        text = self._typing or ""
        if key in "\r\n":
            self._typing = None
            self._filter(text)
        elif key == "\x1b":
            self._typing = None
        elif key in "\x7f\b":
            self._typing = text[:-1]
        elif key.isprintable():
            self._typing = text + key

    def _filter(self, text: str) -> None:
        try:
            self._board.filter = parse(text, "transactions") if text.strip() else None
        except FilterError as error:
            self._note = error.message
            return
        self._board.rows.clear()

    def _turn(self, pages: int) -> None:
        self._top += pages * max(self._screen.size[1] - 2, 1)

    def _ask(self) -> None:
        self._typing = ""

    def _pause(self) -> None:
        self._board.paused = not self._board.paused

    def _mark(self) -> None:
        mark = self._board.mark(time.strftime("%H:%M:%S"))
        self.said.append(f"mark {mark.number} at {mark.text}")
        sys.stderr.flush()

    def _quit(self) -> None:
        self.leaving = True
