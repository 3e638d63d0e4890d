"""The log view: the last transactions, a line each, the newest at the bottom."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import _modlens
from analyzer.views.live.state import LiveState, Mark
from analyzer.views.row_lines import lines as lines_of
from analyzer.views.screen import Part, fit, visible

__all__ = ["lines"]


def lines(state: LiveState, width: int, height: int) -> list[list[Part]]:
    """The column titles and as many rows as there is room for."""
    shown = list(state.rows)[-max(height - 1, 1) :]
    rows = [row for row in shown if not isinstance(row, Mark)]
    if not rows:
        waiting = "no transaction matches the filter yet" if state.filter else "no traffic yet"
        return [[(waiting, "dim")]]
    made = lines_of(rows, state.table_options, width)
    return [made.head(), *_body(shown, made, width)]


def _body(
    shown: Sequence[_modlens.Row | Mark], made: _modlens.Lines, width: int
) -> Iterator[list[Part]]:
    for row in shown:
        if isinstance(row, Mark):
            text = fit(f"--- mark {row.number} {visible(row.text)} ".ljust(width, "-"), width)
            yield [(text, "note")]
        else:
            yield made.row(row)
