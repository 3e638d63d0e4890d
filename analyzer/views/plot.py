"""Draws values over time: in the terminal, and as a picture in SVG or PNG."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from analyzer.installing import how_to_install
from analyzer.views.screen import Part, Screen, visible
from analyzer.views.sparkline import braille
from dissectors.errors import UsageError

__all__ = ["Points", "png", "show_plot", "svg"]

Points = Sequence[tuple[float, float]]
"""Pairs of x and value, in order of x."""

_ROWS = 12
_LABEL_COLUMNS = 12
_SIZE = (1000, 360)
_DPI = 100
_MARGIN = (80, 20, 60, 40)  # left, top, right, bottom
_COLOURS = ("#2a78c8", "#c8641e", "#2e8b57", "#a04bb4", "#b93a3a", "#5f6f7d", "#9a7d0a", "#1c8c9c")


def show_plot(series: Mapping[str, Points], screen: Screen, axis: str) -> None:
    """Print a plot of each series, one below the other, on the same x."""
    left = min(points[0][0] for points in series.values())
    right = max(points[-1][0] for points in series.values())
    width = max(screen.width - _LABEL_COLUMNS - 1, 10)
    for name, points in series.items():
        screen.lines([[(visible(name), "head")], *_rows(points, width, (left, right)), []])
    begin, end = f"{left:g}", f"{right:g} {axis}"
    gap = max(width - len(begin) - len(end), 1)
    screen.line(f"{'':{_LABEL_COLUMNS}} {begin}{' ' * gap}{end}", "dim")


def _rows(points: Points, width: int, span: tuple[float, float]) -> Iterator[list[Part]]:
    low, high = min(y for _, y in points), max(y for _, y in points)
    drawn = braille(points, width, _ROWS, box=(*span, low, high))
    for number, row in enumerate(drawn):
        label = {0: f"{high:g}", len(drawn) - 1: f"{low:g}"}.get(number, "")
        yield [(f"{label:>{_LABEL_COLUMNS}} ", "dim"), (row, "note")]


def svg(series: Mapping[str, Points], axis: str) -> str:
    """The same as a picture; of more than two thousand points, least and greatest ones are kept."""
    (width, height), (left, top, right, bottom) = _SIZE, _MARGIN
    every = [point for points in series.values() for point in points]
    box = (
        min(x for x, _ in every),
        max(x for x, _ in every),
        min(y for _, y in every),
        max(y for _, y in every),
    )
    inner = (width - left - right, height - top - bottom)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height + 20 * len(series)}"'
        ' font-family="sans-serif" font-size="13">',
        f'<rect x="{left}" y="{top}" width="{inner[0]}" height="{inner[1]}" fill="none"'
        ' stroke="#999"/>',
    ]
    for value, y in ((box[3], top + 5), (box[2], height - bottom + 5)):
        parts.append(f'<text x="{left - 8}" y="{y}" text-anchor="end" fill="#666">{value:g}</text>')
    below = height - bottom + 22
    parts.append(f'<text x="{left}" y="{below}" fill="#666">{box[0]:g}</text>')
    parts.append(
        f'<text x="{width - right}" y="{below}" text-anchor="end" fill="#666">{box[1]:g}'
        f" {escape(axis)}</text>"
    )
    for number, (name, points) in enumerate(series.items()):
        colour = _COLOURS[number % len(_COLOURS)]
        path = " ".join(_path(_thinned(points), box, inner))
        parts.append(
            f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.5"/>'
        )
        y = height + 20 * number + 10
        parts.append(f'<text x="{left}" y="{y}" fill="{colour}">{escape(visible(name))}</text>')
    return "\n".join((*parts, "</svg>", ""))


def png(series: Mapping[str, Points], axis: str) -> bytes:
    """The same as pixels, drawn by matplotlib; `UsageError` says how to install it."""
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import
    except ImportError as error:
        needed = how_to_install("matplotlib")
        message = f"plot: a picture as PNG needs a package: {needed}; SVG needs none"
        raise UsageError(message) from error
    left, top, right, bottom = _MARGIN
    width, height = _SIZE[0], _SIZE[1] + 20 * len(series)
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=2 * _DPI)
    axes = figure.add_axes(
        (
            left / width,
            1 - (_SIZE[1] - bottom) / height,
            (width - left - right) / width,
            (_SIZE[1] - top - bottom) / height,
        )
    )
    for points, colour in zip(series.values(), _COLOURS, strict=False):
        thinned = _thinned(points)
        axes.plot([x for x, _ in thinned], [y for _, y in thinned], color=colour, linewidth=1.2)
    axes.set_xlabel(axis.strip("()"))
    axes.grid(visible=True, alpha=0.3)
    for number, (name, colour) in enumerate(zip(series, _COLOURS, strict=False)):
        y = (20 * (len(series) - number) - 12) / height
        # Names are data: nothing between dollar signs is mathematics.
        text = figure.text(left / width, y, visible(name), color=colour, fontsize=9)
        text.set_parse_math(False)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()


def _path(points: Points, box: Sequence[float], inner: Sequence[int]) -> Iterator[str]:
    for x, y in points:
        across = (x - box[0]) / ((box[1] - box[0]) or 1) * inner[0] + _MARGIN[0]
        down = (1 - (y - box[2]) / ((box[3] - box[2]) or 1)) * inner[1] + _MARGIN[1]
        yield f"{across:.1f},{down:.1f}"


_MOST_POINTS = 2000


def _thinned(points: Points) -> Points:
    if len(points) <= _MOST_POINTS:
        return points
    parts = _MOST_POINTS // 2
    found: list[tuple[float, float]] = []
    for number in range(parts):
        start, end = (len(points) * at // parts for at in (number, number + 1))
        part = points[start:end]
        extremes = {min(part, key=lambda point: point[1]), max(part, key=lambda point: point[1])}
        found += sorted(extremes)
    return found
