"""A table that is printed line by line while it is still growing.

The widths are decided from the first rows and never changed again; a number that is wider than its
column pushes its line, a text is cut. So memory stays flat, and a live table does not jump.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from analyzer.views.screen import Part, fit, width_of

__all__ = ["ROOMY", "Cell", "Field", "Grid", "Head", "Items", "Run"]

_STUB = 4
"""A text of fewer columns than this tells nothing."""

ROOMY = 120
"""From this width on: two spaces between columns, longer names, microseconds."""


@dataclass(slots=True)  # not frozen: one is made for each row, and that is three times as fast
class Items:
    """A list of texts or numbers, shown as far as it fits: `555 0 100 … +12`.

    `counts` says how many values each text stands for, where that is not one.

    >>> Items(("555", "0", "100", "7")).within(10)
    '555 0 … +2'
    """

    values: Sequence[str | int]
    counts: Sequence[int] | None = None

    def within(self, width: int) -> str:
        """As many values as fit, and how many more there are."""
        texts = list(map(str, self.values[: width // 2 + 1]))  # each takes two columns at least
        if len(texts) == len(self.values):
            whole = " ".join(texts)
            if width_of(whole) <= width:
                return whole
        rest = len(self.values) if self.counts is None else sum(self.counts)
        widest = len(f"… +{rest}")  # fewer are left each time, so that it never gets wider
        fitting, used, left = 0, 0, rest
        for place, text in enumerate(texts):
            used += width_of(text) + 1
            left -= 1 if self.counts is None else self.counts[place]
            if used + widest > width and used + len(f"… +{left}") > width:
                break
            fitting, rest = fitting + 1, left
        return " ".join([*texts[:fitting], f"… +{rest}"])


@dataclass(slots=True)
class Run:
    """Texts one behind the other in one cell, each in its own style; what does not fit is cut.

    >>> Run([("ok", "good"), ("retry", "odd"), (Items(("555", "0", "100")), "")]).within(17)
    [('ok ', 'good'), ('retry ', 'odd'), ('555 … +2', '')]
    """

    pieces: Sequence[tuple[str | Items, str]]

    def within(self, width: int) -> list[Part]:
        """The parts, at most `width` columns together."""
        parts: list[Part] = []
        for piece, style in self.pieces:
            if not piece:
                continue
            text = piece.within(width) if isinstance(piece, Items) else piece
            if width_of(text) > width:
                text = "" if isinstance(piece, Items) or width < _STUB else fit(text, width)
            if text:
                parts.append((f"{text} ", style))
                width -= width_of(text) + 1
        if parts:
            parts[-1] = (parts[-1][0][:-1], parts[-1][1])
        return parts


Cell = str | Items | Run


@dataclass(frozen=True, slots=True)
class Head:
    """A column: its title, its least and greatest width, its side, and its share of free room.

    Without `most` and `share` (both 0) nothing in the column is cut: what is wider than the first
    rows were pushes its line to the right.
    """

    title: str
    least: int = 1
    right: bool = False
    most: int = 0
    share: int = 0

    def width(self, cells: Iterable[Cell]) -> int:
        """The columns for the title and these cells, without any share."""
        least = max(self.least, width_of(self.title))
        if self.share:
            return least
        widest = max((width_of(_whole(cell)) for cell in cells), default=0)
        return max(least, min(widest, self.most) if self.most else widest)


@dataclass(frozen=True, slots=True)
class Field:
    """A column of a grid: its head, its cell for a row, and that cell's style (in `STYLES`)."""

    head: Head
    cell: Callable[[Any], Cell]
    style: Callable[[Any], str] = lambda _: ""


class Grid:
    """The widths of a table's columns, and its lines.

    `rows` are the first rows, `width` the columns of the terminal.
    """

    def __init__(self, fields: Sequence[Field], rows: Sequence[Any], width: int) -> None:
        self._fields = fields
        self._gap = "  " if width >= ROOMY else " "
        self._widths = [field.head.width(field.cell(row) for row in rows) for field in fields]
        rest = width - sum(self._widths) - len(self._gap) * (len(fields) - 1)
        shares = sum(field.head.share for field in fields)
        for index, field in enumerate(fields):
            share = field.head.share
            if share and rest > 0:
                taken = rest * share // shares
                self._widths[index] += taken
                rest, shares = rest - taken, shares - share

    def head(self) -> list[Part]:
        """The line of titles."""
        return self._join([(field.head.title, "head") for field in self._fields])

    def line(self, row: Any) -> list[Part]:
        """One row as parts to print."""
        return self._join([(field.cell(row), field.style(row)) for field in self._fields])

    def text(self, row: Any) -> str:
        """One row without styles: the same as `line`, at half the cost."""
        cells = []
        for field, width in zip(self._fields, self._widths, strict=True):
            cell = field.cell(row)
            if isinstance(cell, Run):
                cells.append("".join([text for text, _ in cell.within(width)]))
            else:
                cells.append(_fitted(cell, field.head, width))
        return self._gap.join(cells)

    def _join(self, cells: Sequence[tuple[Cell, str]]) -> list[Part]:
        parts: list[Part] = []
        for field, width, (cell, style) in zip(self._fields, self._widths, cells, strict=True):
            if isinstance(cell, Run):
                parts += cell.within(width)
            else:
                parts.append((_fitted(cell, field.head, width), style))
            parts.append((self._gap, ""))
        return parts[:-1]


def _fitted(cell: str | Items, head: Head, width: int) -> str:
    text = cell.within(width) if isinstance(cell, Items) else cell
    if len(text) <= width and text.isascii():
        return text.rjust(width) if head.right else text.ljust(width)
    if width_of(text) > width and not (head.share or head.most):
        return text
    return fit(text, width, right=head.right)


def _whole(cell: Cell) -> str:
    if isinstance(cell, Run):
        return " ".join(_whole(piece) for piece, _ in cell.pieces)
    return " ".join(map(str, cell.values)) if isinstance(cell, Items) else cell
