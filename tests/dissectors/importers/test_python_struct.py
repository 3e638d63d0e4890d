"""Layouts of `struct` against Python's own `struct`, by the place of each value's bytes."""

from __future__ import annotations

import random
import struct

import pytest

from dissectors.importers.profile_builder import NotConvertible
from dissectors.importers.python_struct import points_of_structure

LETTERS = {
    "h": "s16", "H": "u16", "i": "s32", "I": "u32", "q": "s64", "Q": "u64", "e": "f16",
    "f": "f32", "d": "f64",
}  # fmt: skip


def random_items(draw: random.Random) -> list[str]:
    """Letters with and without numbers, and padding of whole registers."""
    return [
        draw.choice(["", "", "2", "3", "12"]) + draw.choice([*LETTERS, *LETTERS])
        if draw.random() < 0.8
        else draw.choice(["2x", "4x", "6x"])
        for _ in range(draw.randint(1, 6))
    ]


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.parametrize("prefix", [">", "!", "<", "=", "@", ""])
def test_values_stand_where_struct_puts_them(prefix: str, seed: int) -> None:
    """A value of a point is at the bytes that `struct` packs it into."""
    items = random_items(random.Random(seed))
    structure = prefix + "".join(items)
    expected = []  # (type, first byte) of every value
    for place, item in enumerate(items):
        letter, number = item[-1], int(item[:-1] or 1)
        before = prefix + "".join(items[:place])
        width = struct.calcsize("=" + letter)
        for value in range(0 if letter == "x" else number):
            end = struct.calcsize(f"{before}{value + 1}{letter}")
            expected.append((LETTERS[letter], end - width))
    if not expected:
        assert points_of_structure(structure, None)[1] == []
        return
    registers, points = points_of_structure(structure, None)
    assert registers * 2 == struct.calcsize(structure)
    width_of = {kind: struct.calcsize("=" + letter) for letter, kind in LETTERS.items()}
    found = [
        (point.type, 2 * point.register + value * width_of[point.type])
        for point in points
        for value in range(2 * (point.count or 0) // width_of[point.type] or 1)
    ]
    assert found == expected
    little = prefix not in (">", "!")
    assert {point.order for point in points} == {"DCBA" if little else None}


@pytest.mark.parametrize("structure", ["", ">", "h2", ">n", ">999999999h", "> h,h", "5"])
def test_what_is_no_structure_is_refused(structure: str) -> None:
    """Each is refused in one sentence."""
    with pytest.raises(NotConvertible, match="structure"):
        points_of_structure(structure, None)
