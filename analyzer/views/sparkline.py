"""A series in one line of text, and a plot of several rows.

>>> sparkline([0, 1, 2, None, 4, 8], 6)
'▁▂▃ ▅█'
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

__all__ = ["braille", "sparkline"]

_LEVELS = "▁▂▃▄▅▆▇█"

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character (Unicode, 15.1 of the standard): rows of two dots."""


def sparkline(values: Sequence[float | None], width: int) -> str:
    """The greatest value of each part in as many characters as there is room for, from 0 up.

    A part without any value is a space.
    """
    parts = list(_parts(values, min(width, len(values))))
    most = max((value for value in parts if value is not None), default=0) or 1
    return "".join(" " if value is None else _level(value / most) for value in parts)


def _level(share: float) -> str:
    return _LEVELS[min(int(share * len(_LEVELS)), len(_LEVELS) - 1) if share > 0 else 0]


def _parts(values: Sequence[float | None], count: int) -> Iterator[float | None]:
    for number in range(count):
        part = values[number * len(values) // count : (number + 1) * len(values) // count]
        yield max((value for value in part if value is not None), default=None)


def braille(
    runs: Sequence[Sequence[tuple[float, float]]],
    width: int,
    height: int,
    *,
    box: Sequence[float],
) -> list[str]:
    """Runs of points in so many characters, those of a run joined by lines.

    `box` is least x, greatest x, and so for y.

    >>> braille([[(0, 0), (1, 1)]], 2, 1, box=(0, 1, 0, 1))
    ['⡠⠊']
    """
    left, right, low, high = box
    columns, rows = 2 * width - 1, 4 * height - 1
    cells = [[0] * width for _ in range(height)]
    for points in runs:
        last: tuple[int, int] | None = None
        for x, y in points:
            across = round((x - left) / ((right - left) or 1) * columns)
            down = rows - round((y - low) / ((high - low) or 1) * rows)
            for column, row in _line(last or (across, down), (across, down)):
                cells[row // 4][column // 2] |= _DOTS[row % 4][column % 2]
            last = across, down
    return ["".join(chr(0x2800 + bits) for bits in row) for row in cells]


def _line(start: tuple[int, int], end: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """The dots from one to the other."""
    steps = max(abs(end[0] - start[0]), abs(end[1] - start[1]), 1)
    for step in range(steps + 1):
        yield (
            start[0] + round((end[0] - start[0]) * step / steps),
            start[1] + round((end[1] - start[1]) * step / steps),
        )
