"""The log view: the last transactions, a line each, the newest at the bottom."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import _modlens
from analyzer.views.live.history import Mark
from analyzer.views.live.state import LiveState
from analyzer.views.row_lines import lines as lines_of
from analyzer.views.screen import Part, fit, visible

__all__ = ["lines"]


def lines(state: LiveState, width: int, height: int) -> list[list[Part]]:
    """The column titles and as many rows as there is room for."""
    shown, _ = state.history.page(max(height - 1, 1))
    rows = [row for row in shown if not isinstance(row, Mark)]
    if not rows:
        waiting = (
            "no transaction matches the filter yet" if state.history.filter else "no traffic yet"
        )
        return [[(waiting, "dim")], *(_mark(row, width) for row in shown if isinstance(row, Mark))]
    made = lines_of(rows, state.table_options, width)
    return [made.head(), *_body(shown, made, width)]


def _body(
    shown: Sequence[_modlens.Row | Mark], made: _modlens.Lines, width: int
) -> Iterator[list[Part]]:
    for row in shown:
        yield _mark(row, width) if isinstance(row, Mark) else made.row(row)


def _mark(mark: Mark, width: int) -> list[Part]:
    return [(fit(f"--- {visible(mark.text)} ".ljust(width, "-"), width), "note")]
