"""The map view: registers and coils in a grid of addresses; changed values are highlighted."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from analyzer.addresses import SHORT, render
from analyzer.views.live.state import LiveState, RegisterValue
from analyzer.views.screen import Part, fit, visible

__all__ = ["lines"]

_BIT_CELLS = {"coil": 2, "discrete_input": 2}
_REGISTER_CELL = 6
_LABEL = 10


def lines(state: LiveState, width: int, height: int) -> list[list[Part]]:
    """A block of lines for each unit and register type; the width decides addresses per line."""
    found = state.values()
    if not found:
        return [[("no values seen yet", "dim")]]
    out: list[list[Part]] = []
    for (bus, unit, kind), group in groupby(found.items(), key=lambda item: item[0][:3]):
        name = f"{visible(bus)}: " if len(state.table_options.buses) > 1 else ""
        out.append([(fit(f"{name}unit {unit} {kind.replace('_', ' ')}s", width), "head")])
        values = {place[3]: value for place, value in group}
        out += _block(values, kind, state, width)
    return out


def _block(
    values: dict[int, RegisterValue], kind: str, state: LiveState, width: int
) -> Iterator[list[Part]]:
    """The lines of one unit and register type; addresses without a value are dots."""
    cell = _BIT_CELLS.get(kind, _REGISTER_CELL)
    per_line = _addresses_per_line((width - _LABEL) // cell)
    now = state.clock()
    for line in sorted({address // per_line for address in values}):
        first = line * per_line
        label = f"{SHORT.get(kind, '')} {render(first, kind, state.table_options.address)}"
        parts: list[Part] = [(fit(label, _LABEL, right=True), "dim")]
        for address in range(first, first + per_line):
            value = values.get(address)
            if value is None:
                parts.append((fit("·", cell, right=True), "dim"))
            else:
                style = "odd" if value.is_highlighted(now) else ""
                parts.append((fit(str(value.value), cell, right=True), style))
        yield parts


def _addresses_per_line(room: int) -> int:
    """The greatest round number of addresses that fits on a line; 4 at least."""
    return next((number for number in (50, 20, 16, 10, 8, 5) if number <= room), 4)
