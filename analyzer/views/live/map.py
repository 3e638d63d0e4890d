"""Registers and coils in a grid of addresses; what changed a moment ago is lit."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from analyzer.addresses import SHORT, render
from analyzer.views.live.state import Board, Value
from analyzer.views.screen import Part, fit, visible

__all__ = ["lines"]

_CELL = {"coil": 2, "discrete_input": 2}
_WIDE = 6
_LABEL = 10


def lines(board: Board, width: int, height: int) -> list[list[Part]]:
    """Blocks by unit and type; a line holds ten addresses, or as many as there is room for."""
    found = board.values()
    if not found:
        return [[("no values seen yet", "dim")]]
    out: list[list[Part]] = []
    for (bus, unit, kind), group in groupby(found.items(), key=lambda item: item[0][:3]):
        name = f"{visible(bus)}: " if len(board.look.buses) > 1 else ""
        out.append([(fit(f"{name}unit {unit} {kind.replace('_', ' ')}s", width), "head")])
        values = {place[3]: value for place, value in group}
        out += _block(values, kind, board, width)
    return out


def _block(values: dict[int, Value], kind: str, board: Board, width: int) -> Iterator[list[Part]]:
    cell = _CELL.get(kind, _WIDE)
    across = _across((width - _LABEL) // cell)
    now = board.clock()
    for line in sorted({address // across for address in values}):
        first = line * across
        label = f"{SHORT.get(kind, '')} {render(first, kind, board.look.address)}"
        parts: list[Part] = [(fit(label, _LABEL, right=True), "dim")]
        for address in range(first, first + across):
            value = values.get(address)
            if value is None:
                parts.append((fit("·", cell, right=True), "dim"))
            else:
                style = "odd" if value.lit(now) else ""
                parts.append((fit(str(value.value), cell, right=True), style))
        yield parts


def _across(room: int) -> int:
    """Round numbers of addresses on a line."""
    return next((number for number in (50, 20, 16, 10, 8, 5) if number <= room), 4)
