"""The views of the live screen: one file each, with a function from `LiveState` to lines.

A view draws what `LiveState` has gathered into the room it gets; it reads no ports and no keys.
`VIEWS` is the registry: name for `modlens tap --view NAME`, and the key that shows it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass

from analyzer.views.live.state import LiveState
from analyzer.views.screen import Part

__all__ = ["VIEWS", "Line", "View", "draw"]

Line = list[Part]


@dataclass(frozen=True, slots=True)
class View:
    """A screen: its key, what it shows, its module with `lines(state, width, height)`."""

    key: str
    title: str
    module: str


VIEWS = {
    "log": View("l", "a line for each transaction", "analyzer.views.live.log"),
    "table": View("t", "by unit and function: counts, errors, times", "analyzer.views.live.table"),
    "map": View("m", "last value of each register, updated in place", "analyzer.views.live.map"),
    "health": View(
        "h", "what is wrong; utilization, poll cycle, margins", "analyzer.views.live.health"
    ),
}
"""Name -> view."""


def draw(name: str, state: LiveState, width: int, height: int) -> list[Line]:
    """The lines of a view; more than `height` where it can be scrolled."""
    lines: Callable[[LiveState, int, int], list[Line]] = importlib.import_module(
        VIEWS[name].module
    ).lines
    return lines(state, width, height)
