"""The map view: registers and coils in a grid of addresses, with their age.

Changed values are highlighted, old ones dim. The letter after a value says what it is for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from itertools import groupby

from analyzer.addresses import SHORT, render
from analyzer.counts import count_of
from analyzer.views.live.roles import LETTERS, REST, UNDECIDED
from analyzer.views.live.state import LiveState, LiveValue
from analyzer.views.live.status import age
from analyzer.views.screen import Part, fit, visible, width_of

__all__ = ["lines"]

_BIT_CELLS = {"coil": 2, "discrete_input": 2}
_REGISTER_CELL = 7
_LABEL = 10
_AGE = 8
_OLD_S = 10.0
"""Values that were not seen for so long are shown dim."""


def lines(state: LiveState, width: int, height: int) -> list[list[Part]]:
    """A block of lines for each unit and register type; the width decides addresses per line."""
    found = state.values()
    if not found:
        return [[("no values seen yet", "dim")]]
    if state.marked.answers:
        return _kept(state, width)
    letters = _letters(state)
    out = _legend(set(letters.values()), width)
    shown: set[tuple[str, int]] = set()
    for (bus, unit, kind), group in groupby(found.items(), key=lambda item: item[0][:3]):
        name = f"{visible(bus)}: " if len(state.table_options.buses) > 1 else ""
        title = f"{name}unit {unit} {kind.replace('_', ' ')}s"
        dead = _dead(state, bus, unit)
        room = min(max(width - len(dead), 0), width_of(title))
        out.append([(fit(title, room), "head"), (fit(dead, width - room), "bad")])
        if (bus, unit) not in shown:
            shown.add((bus, unit))
            named = state.named(bus, unit)
            units = {name: state.unit_of_measure(bus, unit, name) for name in named}
            out += _named(named, units, state.clock(), width)
        values = {place[3]: value for place, value in group}
        of_block = {at: letters.get((unit, kind, at), "") for at in values}
        out += _block(values, kind, of_block, state, width)
    return out


def _letters(state: LiveState) -> Mapping[tuple[int, str, int], str]:
    """The letter of each register. Of several buses there are none: their units may be alike."""
    return state.roles.letters(state.clock()) if len(state.table_options.buses) == 1 else {}


def _legend(letters: Set[str], width: int) -> list[list[Part]]:
    """The meaning of the letters that are shown."""
    names = {letter: name for name, letter in LETTERS.items()}
    names |= {REST: "more of a number", UNDECIDED: "undecided"}
    said = "  ".join(f"{letter} {name}" for letter, name in names.items() if letter in letters)
    return [[(fit(said, width), "dim")]] if said else []


def _kept(state: LiveState, width: int) -> list[list[Part]]:
    """The registers that did what was asked for since the marks, with the step since the last."""
    marked, raw = state.marked, state.raw()
    kept = sorted(place for place in marked.values if place in raw)
    said = ", then ".join(marked.answers)
    out: list[list[Part]] = [[(fit(f"{count_of(len(kept), 'candidate')}: {said}", width), "head")]]
    for place in kept:
        bus, unit, kind, address = place
        name = f"{visible(bus)}: " if len(state.table_options.buses) > 1 else ""
        where = (
            f"{name}unit {unit} {SHORT[kind]} {render(address, kind, state.table_options.address)}"
        )
        step = marked.step(place, raw)
        out.append([
            (fit(where, 24), ""), (fit(str(raw[place]), 8, right=True), ""),
            (fit(f"{step:+d}" if step else "same", 9, right=True), "odd" if step else "dim"),
        ])  # fmt: skip
    if not kept:
        out.append([("none is left: a shows all again, k marks again", "dim")])
    return out


def _block(
    values: dict[int, LiveValue],
    kind: str,
    letters: Mapping[int, str],
    state: LiveState,
    width: int,
) -> Iterator[list[Part]]:
    """The lines of one unit and register type, with the age of the oldest value on each.

    Addresses without a value are dots.
    """
    cell = _BIT_CELLS.get(kind, _REGISTER_CELL)
    per_line = _addresses_per_line((width - _LABEL - _AGE) // cell)
    now = state.clock()
    if len(values) > 1:
        yield _ruler(per_line, cell)
    for line in sorted({address // per_line for address in values}):
        first = line * per_line
        label = f"{SHORT.get(kind, '')} {render(first, kind, state.table_options.address)}"
        parts: list[Part] = [(fit(label, _LABEL, right=True), "dim")]
        for address in range(first, first + per_line):
            value = values.get(address)
            room = cell if kind in _BIT_CELLS else cell - 1
            if value is None:
                parts.append((fit("·", room, right=True), "dim"))
            else:
                parts.append((fit(str(value.value), room, right=True), _style(value, now)))
            if room < cell:
                parts.append((letters.get(address) or " ", "dim"))
        seen = min(values[at].seen for at in range(first, first + per_line) if at in values)
        style = "odd" if now - seen >= _OLD_S else "dim"
        yield [*parts, (fit(age(now - seen), _AGE, right=True), style)]


def _ruler(per_line: int, cell: int) -> list[Part]:
    """The offsets above the columns; of bits the last digit, as no more has room."""
    texts = (f"+{at} " if cell > len("+00") else str(at % 10) for at in range(per_line))
    return [(" " * _LABEL + "".join(fit(text, cell, right=True) for text in texts), "dim")]


def _named(
    values: dict[str, LiveValue], units: dict[str, str], now: float, width: int
) -> Iterator[list[Part]]:
    """Names and scaled values with their units side by side, in columns of equal width."""
    if not values:
        return
    names = max(width_of(visible(name)) for name in values)
    texts = {name: visible(f"{one.value} {units[name]}".rstrip()) for name, one in values.items()}
    numbers = max(map(width_of, texts.values()))
    cell = names + numbers + 3
    per_line = max((width - 2) // cell, 1)
    items = list(values.items())
    for at in range(0, len(items), per_line):
        parts: list[Part] = [("  ", "")]
        for name, value in items[at : at + per_line]:
            parts.append((fit(visible(name), names) + " ", "note"))
            parts.append((fit(texts[name], numbers, right=True) + "  ", _style(value, now)))
        yield parts


def _style(value: LiveValue, now: float) -> str:
    if value.is_highlighted(now):
        return "odd"
    return "dim" if now - value.seen >= _OLD_S else ""


def _dead(state: LiveState, bus: str, unit: int) -> str:
    """How long a unit has been silent that does not answer; empty for one that does."""
    found = state.age(bus, unit)
    if not found.is_dead or found.answered is None:
        return ""
    return f"  no response for {age(state.clock() - found.answered)}"


def _addresses_per_line(room: int) -> int:
    """The greatest round number of addresses that fits on a line; 4 at least."""
    return next((number for number in (50, 20, 16, 10, 8, 5) if number <= room), 4)
