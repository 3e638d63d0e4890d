"""The log: the last transactions, a line each, the newest at the bottom."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from analyzer.views.grid import ROOMY, Grid
from analyzer.views.live.board import Board, Mark
from analyzer.views.moments import Moments
from analyzer.views.screen import Part, fit, visible
from analyzer.views.tables import fields

__all__ = ["lines"]


def lines(board: Board, width: int, height: int) -> list[list[Part]]:
    """The head and as many rows as there is room for."""
    shown = list(board.rows)[-max(height - 1, 1) :]
    rows = [row for row in shown if not isinstance(row, Mark)]
    if not rows:
        waiting = "nothing passed the filter yet" if board.filter else "nothing heard yet"
        return [[(waiting, "dim")]]
    moments = Moments(board.look.times, rows, digits=6 if width >= ROOMY else 3)
    grid = Grid(fields("transactions", board.look, rows, width, moments), rows, width)
    return [grid.head(), *_body(shown, grid, moments, width)]


def _body(
    shown: Sequence[object], grid: Grid, moments: Moments, width: int
) -> Iterator[list[Part]]:
    for row in shown:
        if isinstance(row, Mark):
            text = fit(f"--- mark {row.number} {visible(row.text)} ".ljust(width, "-"), width)
            yield [(text, "note")]
        else:
            yield grid.line(row)
            moments.advance(row)
