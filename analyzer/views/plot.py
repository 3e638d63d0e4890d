"""Draws values over time: in the terminal, and as a picture in SVG or PNG."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from typing import Any

from analyzer.installing import how_to_install
from analyzer.views.plot_series import Axis, Plot, Point, Series, runs, text_of, ticks
from analyzer.views.screen import Part, Screen, visible
from analyzer.views.sparkline import braille
from dissectors.errors import UsageError

__all__ = ["png", "show_plot", "svg"]

_ROWS = 12
_LABEL_COLUMNS = 12
_SIZE = (1000, 360)
_DPI = 100
_MARGIN = (80, 20, 60, 40)  # left, top, right, bottom
_COLOURS = ("#2a78c8", "#c8641e", "#2e8b57", "#a04bb4", "#b93a3a", "#5f6f7d", "#9a7d0a", "#1c8c9c")
_DASHES = ("", "7 3", "2 3", "10 3 2 3", "14 4", "4 6", "1 4", "12 3 2 3 2 3")


def show_plot(plot: Plot, screen: Screen, axis: Axis) -> None:
    """Print a plot of each series, one below the other, on the same x."""
    left = min(series.at[0] for series in plot.values())
    right = max(series.at[-1] for series in plot.values())
    width = max(screen.width - _LABEL_COLUMNS - 1, 10)
    for name, series in plot.items():
        screen.lines(
            [[(_titled(name, series), "head")], *_rows(series, axis, width, (left, right)), []]
        )
    begin, end = (text_of(at, axis, step=_step(right - left)) for at in (left, right))
    if axis == "utc" and begin[:10] == end[:10]:
        end = end[11:]
    end = f"{end} {_AXES[axis]}"
    gap = max(width - len(begin) - len(end), 1)
    screen.line(f"{'':{_LABEL_COLUMNS}} {begin}{' ' * gap}{end}", "dim")


_AXES: Mapping[Axis, str] = {"utc": "UTC", "seconds": "s", "transaction": "(transaction)"}


def _step(length: float) -> float:
    """How far the places of a terminal are apart, in round words: minutes for hours."""
    return 60.0 if length >= 7200 else 1.0 if length >= 10 else 0.001  # noqa: PLR2004


def _titled(name: str, series: Series) -> str:
    return visible(f"{name} ({series.unit})" if series.unit else name)


def _rows(
    series: Series, axis: Axis, width: int, span: tuple[float, float]
) -> Iterator[list[Part]]:
    low, high = min(series.values), max(series.values)
    drawn = braille(runs(series, series.points, axis), width, _ROWS, box=(*span, low, high))
    for number, row in enumerate(drawn):
        label = {0: f"{high:g}", len(drawn) - 1: f"{low:g}"}.get(number, "")
        yield [(f"{label:>{_LABEL_COLUMNS}} ", "dim"), (row, "note")]


def svg(plot: Plot, axis: Axis) -> str:
    """Draw the series into one SVG picture, at most as many as there are colours.

    Of a series with more than `_MOST_POINTS`, the least and the greatest of each stretch are drawn.
    """
    (width, height), (left, top, right, bottom) = _SIZE, _MARGIN
    every = [point for series in plot.values() for point in series.points]
    box = (
        min(x for x, _ in every),
        max(x for x, _ in every),
        min(y for _, y in every),
        max(y for _, y in every),
    )
    inner = (width - left - right, height - top - bottom)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height + 20 * len(plot)}"'
        ' font-family="sans-serif" font-size="13">',
        f'<rect x="{left}" y="{top}" width="{inner[0]}" height="{inner[1]}" fill="none"'
        ' stroke="#999"/>',
        *_svg_axes(box, inner, axis, _unit_of_all(plot)),
    ]
    for number, (name, series) in enumerate(plot.items()):
        colour = _COLOURS[number % len(_COLOURS)]
        dash = f' stroke-dasharray="{_DASHES[number]}"' if _DASHES[number] else ""
        for run in runs(series, _thinned(series.points), axis):
            # A line from a point to itself is a dot.
            path = " ".join(_path(run if len(run) > 1 else run * 2, box, inner))
            parts.append(
                f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.5"'
                f' stroke-linecap="round"{dash}/>'
            )
        y = height + 20 * number + 10
        parts.append(
            f'<text x="{left}" y="{y}" fill="{colour}">{escape(_titled(name, series))}</text>'
        )
    return "\n".join((*parts, "</svg>", ""))


def _svg_axes(box: Sequence[float], inner: Sequence[int], axis: Axis, unit: str) -> Iterator[str]:
    (width, height), (left, top, right, bottom) = _SIZE, _MARGIN
    for value, y in ((box[3], top + 5), (box[2], height - bottom + 5)):
        yield f'<text x="{left - 8}" y="{y}" text-anchor="end" fill="#666">{value:g}</text>'
    if unit:
        middle = top + inner[1] // 2
        shown = escape(unit)
        yield f'<text x="{left - 8}" y="{middle}" text-anchor="end" fill="#666">{shown}</text>'
    below = height - bottom + 20
    for at, text in ticks(box[0], box[1], axis):
        x = (at - box[0]) / ((box[1] - box[0]) or 1) * inner[0] + left
        yield f'<path d="M{x:.1f} {height - bottom}v5" stroke="#999"/>'
        yield f'<text x="{x:.1f}" y="{below}" text-anchor="middle" fill="#666">{text}</text>'
    label = f"{_days(box[0], box[1])} UTC" if axis == "utc" else _AXES[axis]
    yield f'<text x="{width - right}" y="{below + 17}" text-anchor="end" fill="#666">{label}</text>'


def _days(left: float, right: float) -> str:
    return " to ".join(dict.fromkeys(text_of(at, "utc")[:10] for at in (left, right)))


def _unit_of_all(plot: Plot) -> str:
    """The unit of measure of the y axis, where all series have the same."""
    units = {series.unit for series in plot.values()}
    return visible(units.pop()) if len(units) == 1 else ""


def png(plot: Plot, axis: Axis) -> bytes:
    """Draw the series into one PNG picture with matplotlib, twice as large as `svg` in pixels.

    Without matplotlib, `UsageError` says how to install it.
    """
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra, and slow to import
    except ImportError as error:
        needed = how_to_install("matplotlib")
        message = f"plot: a picture as PNG needs a package: {needed}; SVG needs none"
        raise UsageError(message) from error
    left, top, right, bottom = _MARGIN
    width, height = _SIZE[0], _SIZE[1] + 20 * len(plot)
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=2 * _DPI)
    axes = figure.add_axes(
        (
            left / width,
            1 - (_SIZE[1] - bottom) / height,
            (width - left - right) / width,
            (_SIZE[1] - top - bottom) / height,
        )
    )
    for series, colour, dash in zip(plot.values(), _COLOURS, _DASHES, strict=False):
        for run in runs(series, _thinned(series.points), axis):
            x: list[Any] = [
                datetime.fromtimestamp(at, UTC) if axis == "utc" else at for at, _ in run
            ]
            (line,) = axes.plot(x, [y for _, y in run], color=colour, linewidth=1.2)
            line.set_linestyle("--" if dash else "-")
            line.set_marker("." if len(run) == 1 else "")
    axes.set_xlabel({"utc": "UTC"}.get(axis, _AXES[axis].strip("()")))
    axes.set_ylabel(_unit_of_all(plot)).set_parse_math(False)
    axes.grid(visible=True, alpha=0.3)
    for number, ((name, series), colour) in enumerate(zip(plot.items(), _COLOURS, strict=False)):
        y = (20 * (len(plot) - number) - 12) / height
        # Names are data: nothing between dollar signs is mathematics.
        text = figure.text(left / width, y, _titled(name, series), color=colour, fontsize=9)
        text.set_parse_math(False)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()


def _path(points: Sequence[Point], box: Sequence[float], inner: Sequence[int]) -> Iterator[str]:
    for x, y in points:
        across = (x - box[0]) / ((box[1] - box[0]) or 1) * inner[0] + _MARGIN[0]
        down = (1 - (y - box[2]) / ((box[3] - box[2]) or 1)) * inner[1] + _MARGIN[1]
        yield f"{across:.1f},{down:.1f}"


_MOST_POINTS = 2000


def _thinned(points: Sequence[Point]) -> Sequence[Point]:
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
