"""Draws one frame, or a request and its response: bytes beside their meaning.

The blocks come from `dissectors.describe`; here they are laid out in the columns offset, bytes,
field, value and meaning.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import Any

from analyzer.views.screen import Part, Screen, fit, visible, width_of
from dissectors.describe import Piece

__all__ = ["show_findings", "show_frame", "show_pause"]

TITLES = ("offset", "bytes", "field", "value", "meaning")
STYLES = ("dim", "note", "", "", "")
MAX_WIDTHS = (6, 23, 22, 18)
"""Greatest width of the first four columns; 23 characters hold eight bytes."""

MIN_MEANING_WIDTH = 16
GAP = "  "
INDENT = "  "


def show_frame(title: str, pieces: Sequence[Piece], screen: Screen) -> None:
    """Print a title and the blocks of a frame; invalid blocks are highlighted.

    Nothing is cut off: long texts take several lines.
    """
    screen.lines([[(visible(title), "head")], *_table(pieces, screen.width)])


def show_pause(text: str, screen: Screen) -> None:
    """Print the text between two frames, such as the response time."""
    screen.lines([[], [(visible(text), "note")]])


def show_findings(findings: Sequence[Mapping[str, Any]], screen: Screen) -> None:
    """Print findings: `severity`, `code`, `detail` and `advice` of each."""
    for found in findings:
        style = {"error": "bad", "warning": "odd"}.get(found["severity"], "note")
        screen.lines([[], [(f"{found['severity']}: {found['code']}", style)]])
        for text in (found["detail"], found["advice"]):
            screen.lines([(INDENT + line, "")] for line in _wrapped(text, screen.width - 2))


def _table(pieces: Sequence[Piece], width: int) -> Iterator[list[Part]]:
    """The lines of the table; the last column takes the width that is left."""
    rows = [_cells(piece) for piece in pieces]
    widths = [
        min(most, max(len(head), *(width_of(line) for row in rows for line in row[column])))
        for column, (head, most) in enumerate(zip(TITLES, MAX_WIDTHS, strict=False))
    ]
    rest = width - sum(widths) - len(GAP) * len(widths)
    widths.append(max(rest, MIN_MEANING_WIDTH))
    yield _line(TITLES, widths, ["head"] * len(TITLES))
    for piece, row in zip(pieces, rows, strict=True):
        meaning = _wrapped(piece.meaning, widths[-1])
        styles = [*STYLES[:-1], "" if piece.is_valid else "bad"]
        for cells in zip_longest(*row, meaning, fillvalue=""):
            yield _line(cells, widths, styles)


def _cells(piece: Piece) -> list[list[str]]:
    """The first four cells of a block, each as a list of lines."""
    _, bytes_wide, name_wide, value_wide = MAX_WIDTHS
    digits = textwrap.wrap(piece.data.hex(" "), bytes_wide)
    name = textwrap.wrap(visible(piece.name), name_wide)
    value = _wrapped(piece.value, value_wide)
    return [[str(piece.offset)], digits or [""], name or [""], value]


def _wrapped(text: str | None, width: int) -> list[str]:
    return textwrap.wrap(visible(text or ""), width) or [""]


def _line(cells: Sequence[str], widths: Sequence[int], styles: Sequence[str]) -> list[Part]:
    parts: list[Part] = []
    for column, (cell, width, style) in enumerate(zip(cells, widths, styles, strict=True)):
        parts.append((fit(cell, width, right=column == 0), style))
        parts.append((GAP, ""))
    return parts[:-1]
