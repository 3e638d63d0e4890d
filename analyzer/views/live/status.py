"""Draws the line of the live screens that shows the state of each bus."""

from __future__ import annotations

from analyzer.counts import count_of
from analyzer.live_run import BusStatus
from analyzer.views.cells import labels
from analyzer.views.live.activity import BusActivity
from analyzer.views.live.state import LiveState
from analyzer.views.screen import Part, fit, visible, width_of

__all__ = ["age", "status_line"]

_QUIET_S = 5.0
"""After so long without a frame a bus is shown as quiet."""

_MIN_BYTES = 24
_BETWEEN = " | "


def status_line(state: LiveState, width: int) -> list[Part]:
    """Line settings, the last frame, lost ports: as much as fits, the same share for each bus."""
    statuses = state.bus_statuses
    names = labels([status.bus for status in statuses])
    parts: list[Part] = _recording_trouble(state, width)
    left = width - sum(width_of(text) for text, _ in parts)
    for at, status in enumerate(statuses):
        name = f"{visible(names[status.bus])}: " if len(statuses) > 1 else ""
        text, style = _state(status, state.activity.of(status.bus), state)
        share = (left - len(_BETWEEN) * (len(statuses) - at - 1)) // (len(statuses) - at)
        shown = f"{name}{text}"
        if width_of(shown) > share or at == len(statuses) - 1:
            shown = fit(shown, max(share, 0))
        parts.append((shown, style))
        left -= width_of(shown)
        if at + 1 < len(statuses):
            parts.append((_BETWEEN, "dim"))
            left -= len(_BETWEEN)
    return parts


def _recording_trouble(state: LiveState, width: int) -> list[Part]:
    """That nothing can be recorded, at the beginning of the line; it may take most of it."""
    trouble = state.trouble()
    if trouble is None:
        return []
    text = f"NOT RECORDING: {visible(trouble)}"
    return [(fit(text, min(width_of(text), width * 2 // 3)), "bad"), (_BETWEEN, "dim")]


def _state(status: BusStatus, activity: BusActivity, state: LiveState) -> tuple[str, str]:
    """The state of a bus in words, with its style."""
    settings = f"{status.settings} " if status.settings else ""
    if status.lost_s is not None:
        return f"port lost {age(status.lost_s)} ago, waiting for it", "bad"
    if status.origin == "searching":
        return f"finding the line settings, now {settings.strip()}", "odd"
    found = "(found) " if status.origin == "found" else ""
    if activity.last_frame_s is None:
        if activity.received < _MIN_BYTES:
            return f"{settings}{found}nothing received for {age(state.elapsed)}", "odd"
        received = count_of(activity.received, "byte")
        return f"{settings}{found}{received}, no valid frame: wrong line settings?", "bad"
    silent = state.clock() - activity.last_frame_s
    style = "odd" if silent >= _QUIET_S else "good"
    return f"{settings}{found}last frame {age(silent)} ago", style


def age(seconds: float) -> str:
    """A time in at most four characters or so.

    >>> [age(seconds) for seconds in (0.04, 9.96, 59.9, 60, 3600, 90000)]
    ['0 s', '9 s', '59 s', '1 min', '1 h', '25 h']
    """
    whole = int(seconds)
    if whole < 60:  # noqa: PLR2004 - a minute
        return f"{whole} s"
    return f"{whole // 60} min" if whole < 3600 else f"{whole // 3600} h"  # noqa: PLR2004 - an hour
