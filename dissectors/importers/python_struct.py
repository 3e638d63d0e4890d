"""Layouts of Python's `struct` (`>hH5h`), which Home Assistant's `structure` is written in.

Source: Python's library reference, `struct`, "Format Characters" and "Byte Order, Size, and
Alignment". Sizes are the standard ones; values are aligned where `struct` aligns them, which is
with `@` and without a prefix.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from dissectors.importers.profile_builder import (
    REGISTERS_OF_TYPE,
    NotConvertible,
    compose_orders,
)

__all__ = ["StructurePoint", "points_of_structure"]

_TYPE_AND_BYTES = {
    "b": ("s8", 1), "B": ("u8", 1), "h": ("s16", 2), "H": ("u16", 2), "i": ("s32", 4),
    "I": ("u32", 4), "l": ("s32", 4), "L": ("u32", 4), "q": ("s64", 8), "Q": ("u64", 8),
    "e": ("f16", 2), "f": ("f32", 4), "d": ("f64", 8), "s": ("str", 1), "x": ("", 1),
}  # fmt: skip
_SWAPS_WORDS = ("CDAB", "DCBA")
_SWAPS_BYTES = ("BADC", "DCBA")


@dataclass(frozen=True, slots=True)
class StructurePoint:
    """A value, or several of one type that follow one another, within a structure.

    - `first_value`: place of its (first) value among all values, from 1
    - `register`: its first register, from the first of the structure
    - `count`: its registers, where its type does not say them
    """

    first_value: int
    register: int
    type: str
    count: int | None
    order: str | None


@dataclass(frozen=True, slots=True)
class _Run:
    """Values of one type that follow one another; padding has the type "".

    - `first_value`: place of the first one among all values, from 1
    - `offset`, `width`: first byte of the first one, and bytes of each
    - `values`: how many; a text of n bytes is one value of n bytes
    """

    type: str
    first_value: int
    offset: int
    width: int
    values: int

    @property
    def end(self) -> int:
        return self.offset + self.width * self.values


def points_of_structure(structure: str, swap: str | None) -> tuple[int, list[StructurePoint]]:
    """The registers that a structure takes, and its points; `swap` is applied to all of them.

    Swapped words turn round the registers of the whole structure. `NotConvertible` where a profile
    has no type for a value.

    >>> registers, points = points_of_structure(">hH5h", None)
    >>> registers, [(point.register, point.type, point.count) for point in points]
    (7, [(0, 's16', None), (1, 'u16', None), (2, 's16', 5)])
    """
    match = re.fullmatch(r"([@=<>!]?)((?:\s*\d*[a-zA-Z?])+)\s*", structure, re.ASCII)
    if not match:
        raise NotConvertible(f"structure {structure!r} is not understood")
    prefix, items = match.groups()
    runs = list(_runs(re.findall(r"(\d*)([a-zA-Z?])", items), aligned=prefix in ("", "@")))
    size = max(run.end for run in runs)
    if size % 2 or not size:
        raise NotConvertible(f"structure {structure!r} takes {size} bytes: no whole registers")
    # Without a prefix, or with = or @, `struct` uses the machine's byte order, which is nearly
    # always little-endian.
    order = None if prefix in (">", "!") else "DCBA"
    points = []
    for run in _joined(runs):
        for point in _points(run, order, swap):
            first = point.register
            if swap in _SWAPS_WORDS:
                first = size // 2 - first - (point.count or REGISTERS_OF_TYPE[point.type])
            points.append(replace(point, register=first))
    return size // 2, points


def _points(run: _Run, order: str | None, swap: str | None) -> Iterator[StructurePoint]:
    """The points of a run: one, or one for each half of a register.

    `order` is that of the numbers in the structure; texts and half registers only have a `swap`.
    """
    if run.type in ("s8", "u8"):
        for number in range(run.values):
            register, low = divmod(run.offset + number, 2)
            half = "l" if bool(low) != (swap in _SWAPS_BYTES) else "h"
            yield StructurePoint(run.first_value + number, register, run.type + half, None, None)
        return
    if run.offset % 2:
        raise NotConvertible(f"value {run.first_value} begins in the middle of a register")
    if run.type == "str":
        if swap in _SWAPS_WORDS:
            raise NotConvertible("registers of a text in turned order")
        order = None
    registers = (run.end - run.offset + 1) // 2
    count = registers if run.type == "str" or run.values > 1 else None
    orders = compose_orders(order, swap) if order or swap else None
    yield StructurePoint(run.first_value, run.offset // 2, run.type, count, orders)


def _runs(items: list[tuple[str, str]], *, aligned: bool) -> Iterator[_Run]:
    """The runs of (number, letter), each where `struct` puts it."""
    offset, first_value = 0, 1
    for number, letter in items:
        if letter not in _TYPE_AND_BYTES:
            raise NotConvertible(f"structure with {letter!r}, which no register holds")
        kind, width = _TYPE_AND_BYTES[letter]
        values = _repetition(number)
        if aligned:
            offset += -offset % width
        if kind == "str":
            width, values = values, 1
        run = _Run(kind, first_value, offset, width, values)
        yield run
        offset = run.end
        first_value += values if kind else 0


def _repetition(number: str) -> int:
    """How often a letter counts; more than the 131,072 bytes of all registers is refused."""
    if len(number) > len("131072") or int(number or 1) > 2 * 0x10000:
        raise NotConvertible(f"structure with {number[:9]} values, which no device has")
    return int(number or 1)


def _joined(runs: list[_Run]) -> list[_Run]:
    """Runs without padding; neighbours of one type are one run (`hhh` is `3h`), texts are not."""
    joined: list[_Run] = []
    for run in runs:
        last = joined[-1] if joined else None
        if last and last.type == run.type != "str" and last.end == run.offset:
            joined[-1] = replace(last, values=last.values + run.values)
        elif run.type and run.end > run.offset:
            joined.append(run)
    return joined
