"""The candidates of `modlens find`, and the time at which they differ most."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from analyzer.views.screen import Part, Screen, fit

__all__ = ["show_candidates"]

_CERTAIN = 0.999
_SURE = 0.9
_LEAST = 0.01
_ROUNDING = 1e-9


def show_candidates(
    found: Mapping[str, Any], limit: int, time_text: Callable[[int], str], screen: Screen
) -> None:
    """Print the best candidates, one line each, and what would decide between them."""
    candidates = found["candidates"]
    several = "candidate" if len(candidates) == 1 else "candidates"
    tried = f"{found['readings']:,} readings of {found['registers']:,} registers tried"
    screen.line(f"{tried}, {len(candidates)} {several}", "head")
    if not candidates:
        screen.line("  nothing fits: a wider --within, or another time, may help", "dim")
        return
    screen.lines(_line(rank, one) for rank, one in enumerate(candidates[:limit], 1))
    none = max(0.0, 1 - sum(one["chance"] for one in candidates))
    if none >= _LEAST:
        screen.line(
            f"      none of these: the value was not on the line{chance_text(none):>9}", "dim"
        )
    if len(candidates) > limit:
        screen.line(f"      {len(candidates) - limit} more with --limit", "dim")
    best = candidates[0]["chance"]
    if best < none:
        screen.line("Probably none of these: are the value and its time right?", "dim")
    plausible = [one for one in candidates if one["chance"] >= _LEAST]
    look = found["look"]
    if look is not None:
        values = ", ".join(
            f"{place(one)} {_shown(value, one['scale'])}"
            for one, value in zip(candidates, look["values"], strict=False)
        )
        when = time_text(look["time_ns"])
        screen.line(f"Tell them apart: a second value, best at {when} ({values})")
    elif len(plausible) > 1:
        screen.line("The recording cannot tell them apart: their values are always alike.", "dim")
    elif none <= best < _SURE:
        screen.line("A second value at another time would show whether it is the first one.", "dim")


def _line(rank: int, one: Mapping[str, Any]) -> Sequence[Part]:
    order = "" if one["count"] == 1 else f" {one['order']}"
    reading = f"{one['type']}{order}{_scaling(one['scale'], one['offset'])}"
    style = "good" if rank == 1 and one["chance"] >= _SURE else ""
    line = [
        (f"  {rank:2d}  unit {one['unit']:<3d} ", ""),
        (fit(place(one), 14), style),
        (fit(reading, 26), ""),
        (f"{chance_text(one['chance']):>7}", style),
    ]
    if one["r2"] is not None:
        line.append((f"   r2 {one['r2']:.4f}, lag {one['lag_ns'] / 1e9:.0f} s", "dim"))
    return line


def place(one: Mapping[str, Any]) -> str:
    """The registers of a candidate, such as `hr 84-85` or `hr 3 bit 2`.

    >>> place({"space": "hr", "address": 84, "count": 2, "bit": None})
    'hr 84-85'
    """
    first = one["address"]
    text = f"{one['space']} {first}" + (f"-{first + one['count'] - 1}" if one["count"] > 1 else "")
    return text if one["bit"] is None else f"{text} bit {one['bit']}"


def _scaling(scale: float, offset: float) -> str:
    text = "" if scale == 1 else f" x {scale:.6g}"
    return text if offset == 0 else f"{text} {'+' if offset > 0 else '-'} {abs(offset):.6g}"


def _shown(value: float, scale: float) -> str:
    digits = next((n for n in range(6) if abs(scale * 10**n - round(scale * 10**n)) < _ROUNDING), 3)
    return f"{value:.{digits}f}" if scale != 1 or value == int(value) else f"{value:.4g}"


def chance_text(chance: float) -> str:
    """A probability in words that do not say more than is known.

    >>> chance_text(0.9996), chance_text(0.97), chance_text(0.002)
    ('99.9 %', '97 %', '< 1 %')
    """
    if chance >= _CERTAIN:
        return "99.9 %"
    if chance < _LEAST:
        return "< 1 %"
    return f"{100 * chance:.1f} %" if chance > 0.99 else f"{100 * chance:.0f} %"  # noqa: PLR2004
