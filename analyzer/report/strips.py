"""Small pictures of how a value moved: outlines as SVG paths, one for each colour."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

__all__ = ["band", "states"]

WIDTH, HEIGHT = 120, 16
COLOURS = 8

Spans = Sequence[Sequence[float] | None]
"""The smallest and the largest number of each part of the time; None where there is none."""


def band(spans: Spans) -> list[str]:
    """The range of a number over time, as one outline.

    >>> band([[1, 2], None, [2, 3]])
    ['M0 8.0h40v7.5h-40zM80 0.5h40v7.5h-40z']
    """
    known = [span for span in spans if span is not None]
    least, most = min(low for low, _ in known), max(high for _, high in known)
    room = HEIGHT - 1
    scale = room / (most - least) if most > least else 0.0
    step = WIDTH / len(spans)
    outline = ""
    for at, span in enumerate(spans):
        if span is not None:
            top = 0.5 + (most - span[1]) * scale
            high = max((span[1] - span[0]) * scale, 1.0)
            outline += (
                f"M{at * step:g} {min(top, HEIGHT - high):.1f}h{step:g}v{high:.1f}h-{step:g}z"
            )
    return [outline]


def states(spans: Spans) -> list[str]:
    """The states over time: an outline for each of them, by number.

    >>> states([[1, 1], [1, 1], [3, 3], None])
    ['M0 0h60v16h-60z', 'M60 0h30v16h-30z']
    """
    last = [None if span is None else span[1] for span in spans]
    numbers = sorted({number for number in last if number is not None})
    outlines = [""] * min(len(numbers), COLOURS)
    step, at = WIDTH / len(spans), 0
    for number, run in groupby(last):
        count = len(list(run))
        if number is not None:
            wide = count * step
            outlines[numbers.index(number) % COLOURS] += (
                f"M{at * step:g} 0h{wide:g}v{HEIGHT}h-{wide:g}z"
            )
        at += count
    return outlines
