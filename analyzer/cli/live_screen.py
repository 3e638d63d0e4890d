"""The live screens of `modlens tap --view`: draws them and handles the keys.

`LiveScreen` is a sink like others, so it is called after each batch; it redraws five times a second
at most.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

import _modlens
from analyzer.cli.keys import Keys
from analyzer.counts import count_of
from analyzer.filters import parse
from analyzer.marks import note_mark
from analyzer.views.live import VIEWS, draw
from analyzer.views.live.marked import QUESTIONS, Marked
from analyzer.views.live.state import LiveState
from analyzer.views.live.status import status_line
from analyzer.views.screen import Part, Screen, fit, visible, width_of
from dissectors.errors import FilterError

__all__ = ["LiveScreen"]

REFRESH_S = 0.2
LOG = "log"
MAP = "map"
_FRAME_LINES = 3
"""Lines of the screen besides the view: title, state of the buses, foot."""

_FOOT = "l log t table m map h health  p pause / filter ? keys q quit"
_SHORT_FOOT = "l log t table m map h health  ? keys q quit"
_KEYS = (
    ("PageUp, b", "a page back"),
    ("PageDown, n", "a page on"),
    ("Up, Down", "a line back, a line on"),
    ("Home, End", "the oldest, the newest"),
    ("p, space", "pause the screen; decoding goes on"),
    ("/", "filter the log: an expression as for --where; empty shows everything; Ctrl-U clears it"),
    ("k", "put a mark into the log; the map can then be narrowed down:"),
    *(
        (key, f"in the map: keep what {said} since the mark")
        for key, (said, _) in QUESTIONS.items()
    ),
    ("a", "in the map: show all again"),
    ("?", "these keys"),
    ("q", "quit"),
)
_TURNING = ("PageUp", "PageDown", "Up", "Down", "Home", "End", "n", "b")
_CTRL_U = "\x15"
_FAR = 1_000_000_000
"""Lines beyond any end."""


class LiveScreen:
    """Shows `state` on the terminal, beginning with the view of that name; use it in `with`.

    `quit_requested` is True once the user has pressed q. Messages of the tap (`show_message`)
    appear in the bottom line and are kept in `messages`, so that they can be printed when the
    screen is closed. `recording` names the file beside which marks are noted, if there is one.
    """

    name = "the screen"
    table = ""

    def __init__(
        self,
        state: LiveState,
        view: str,
        screen: Screen,
        recording: Callable[[], str | None] = lambda: None,
    ) -> None:
        self.quit_requested = False
        self.messages: list[str] = []
        self.row_count = 0
        self._state = state
        self._view = view
        self._screen = screen
        self._recording = recording
        self._keys = Keys()
        self._last_drawn_s = float("-inf")
        self._filter_input: str | None = None
        self._message = ""
        self._first_line = 0
        self._shows_keys = False
        self._commands: dict[str, Callable[[], None]] = {
            "q": self._request_quit,
            "\x03": self._request_quit,
            "p": self._toggle_pause,
            " ": self._toggle_pause,
            "k": self._add_mark,
            "/": self._begin_filter_input,
            "n": lambda: self._turn_pages(1),
            "b": lambda: self._turn_pages(-1),
            "PageDown": lambda: self._turn_pages(1),
            "PageUp": lambda: self._turn_pages(-1),
            "Down": lambda: self._turn_lines(1),
            "Up": lambda: self._turn_lines(-1),
            "End": lambda: self._turn_lines(_FAR),
            "Home": lambda: self._turn_lines(-_FAR),
            "?": self._show_keys,
        }

    def put(self, batch: _modlens.Batch) -> None:
        """Add a batch to the state, handle the keys pressed, and redraw if it is time to."""
        self._state.put(batch)
        keys = self._keys.pressed()
        for key in keys:
            self._handle_key(key)
        if keys or time.monotonic() - self._last_drawn_s >= REFRESH_S:
            self.draw()

    def show_message(self, text: str) -> None:
        """Show a message of the tap in the bottom line, and keep it."""
        self.messages.append(text)
        self._message = text

    def draw(self) -> None:
        """Draw the whole screen now, unless the terminal has not even shown the last one."""
        if self._screen.is_behind:
            return
        self._last_drawn_s = time.monotonic()
        self._state.refresh()
        width, height = self._screen.size
        room = max(height - _FRAME_LINES, 1)
        body = _keys() if self._shows_keys else draw(self._view, self._state, width, room)
        self._first_line = max(min(self._first_line, len(body) - room), 0)
        shown = body[self._first_line : self._first_line + room]
        foot = self._footer(width, self._pages(len(shown), len(body), room))
        head = [self._title(width), status_line(self._state, width)]
        self._screen.page([*head, *shown, *[[]] * (room - len(shown)), foot])

    def _pages(self, shown: int, lines: int, room: int) -> str:
        """What part of the view is shown; empty where that is all of it, or its newest end."""
        if self._view == LOG and not self._shows_keys:
            history = self._state.history
            if history.is_at_end:
                return ""
            first = history.page(room - 1)[1]
            return f" {first:,}-{first + room - 2:,} of {len(history):,}, n next b back"
        if lines <= room:
            return ""
        return f" {self._first_line + 1}-{self._first_line + shown} of {lines}, n next b back"

    def close(self) -> None:
        """Nothing to do: the terminal is restored when the `with` block ends."""

    def rollback(self) -> None:
        """Nothing to do: a screen leaves nothing."""

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
        buses = ", ".join(visible(bus) for bus in self._state.table_options.buses)
        state = " PAUSED" if self._state.paused else ""
        elapsed = int(self._state.elapsed)
        clock = f"{elapsed // 3600}:{elapsed // 60 % 60:02d}:{elapsed % 60:02d}"
        right = f" {count_of(self._state.seen, 'transaction')}  {clock}{state}"
        left = f"modlens {self._view}  {buses} "
        room = min(max(width - len(right), 0), width_of(left))
        return [(fit(left, room), "head"), (right[-width:], "head")]

    def _footer(self, width: int, pages: str) -> list[Part]:
        if self._filter_input is not None:
            typed = f"filter: {visible(self._filter_input)}_"
            error = fit(f"  {visible(self._message)}", max(width - width_of(typed), 0))
            return [(fit(typed, min(width_of(typed), width)), "note"), (error, "bad")]
        if self._message:
            return [(fit(visible(self._message), width), "odd")]
        # The filter is that of the log: the other views show all transactions.
        wanted = self._state.history.filter if self._view == LOG else None
        shown = f"filter: {wanted}  " if wanted else ""
        room = max(width - len(pages), 0)
        foot = _FOOT if len(_FOOT) <= room else _SHORT_FOOT
        left = fit(f"{visible(shown)}{foot}", room)
        return [(left, "dim"), (pages[-width:], "note")]

    def _handle_key(self, key: str) -> None:
        self._message = ""
        if self._shows_keys and key not in _TURNING:
            self._shows_keys, self._first_line = False, 0
            if key in "?\x1b ":
                return
        if self._filter_input is not None:
            self._edit_filter_input(key)
        elif self._view == MAP and (key == "a" or (key in QUESTIONS and self._state.marked)):
            self._narrow_down(key)
        elif key in self._commands:
            self._commands[key]()
        else:
            chosen = [name for name, view in VIEWS.items() if view.key == key]
            if chosen:
                self._view, self._first_line = chosen[0], 0

    def _edit_filter_input(self, key: str) -> None:
        text = self._filter_input or ""
        if key in ("\r", "\n"):
            self._filter_input = None
            self._apply_filter(text)
        elif key == "\x1b":
            self._filter_input = None
        elif key in ("\x7f", "\b"):
            self._filter_input = text[:-1]
        elif key == _CTRL_U:
            self._filter_input = ""
        elif len(key) == 1 and key.isprintable():
            self._filter_input = text + key

    def _apply_filter(self, text: str) -> None:
        """Filter the log by this text; one that is not valid stays, to be fixed."""
        try:
            self._state.history.set_filter(parse(text, "transactions") if text.strip() else None)
        except FilterError as error:
            self._filter_input, self._message = text, error.message

    def _turn_pages(self, pages: int) -> None:
        room = max(self._screen.size[1] - _FRAME_LINES, 1)
        # The log has its titles in the first line.
        self._turn_lines(pages * (max(room - 1, 1) if self._turns_the_log else room))

    def _turn_lines(self, lines: int) -> None:
        if self._turns_the_log:
            room = max(self._screen.size[1] - _FRAME_LINES - 1, 1)
            self._state.history.turn(lines, room)
        else:
            # `draw` keeps it inside of what there is.
            self._first_line += lines

    @property
    def _turns_the_log(self) -> bool:
        return self._view == LOG and not self._shows_keys

    def _show_keys(self) -> None:
        self._shows_keys, self._first_line = True, 0

    def _begin_filter_input(self) -> None:
        wanted = self._state.history.filter
        self._filter_input = str(wanted) if wanted else ""

    def _toggle_pause(self) -> None:
        self._state.pause(paused=not self._state.paused)

    def _add_mark(self) -> None:
        mark = self._state.history.mark(f"at {time.strftime('%H:%M:%S')}")
        self.messages.append(mark.text)
        self._state.marked.mark(self._state.raw())
        recording = self._recording()
        if recording is not None:
            try:
                note_mark(recording, self._state.history.marks, time.time_ns())
            except OSError as error:
                self.show_message(f"the mark could not be noted: {error.strerror or error}")
        sys.stderr.flush()

    def _narrow_down(self, key: str) -> None:
        """Keep what the key says since the mark; `a` shows all again."""
        if key == "a":
            self._state.marked = Marked()
        else:
            self._state.marked.keep(key, self._state.raw())
        self._first_line = 0

    def _request_quit(self) -> None:
        self.quit_requested = True


def _keys() -> list[list[Part]]:
    """The lines of the page that `?` shows."""
    views = [(view.key, f"{name}: {view.title}") for name, view in VIEWS.items()]
    return [
        [("keys", "head")],
        *([(fit(f"  {key}", 15), "note"), (what, "")] for key, what in (*views, *_KEYS)),
        [("", "")],
        [("any other key goes back", "dim")],
    ]
