"""Sentences about a run whose recordings and settings can hardly be meant so."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from itertools import combinations
from types import FrameType
from typing import Any

from analyzer.settings import Settings

__all__ = ["doubts", "warn"]

MOST_RECORDINGS = 8
"""Recordings that are compared with each other; more are an archive."""

LEAST_REQUESTS = 20


def doubts(settings: Settings, statistics: Mapping[str, Any]) -> Iterator[str]:
    """What to say at the end of a run about its settings and recordings, one sentence each."""
    if not settings.select:
        yield from _unheard(settings, statistics["buses"])
        yield from _copies(statistics["buses"])


def _unheard(settings: Settings, buses: list[dict[str, Any]]) -> Iterator[str]:
    """Profiles of units that no bus has."""
    for one in settings.profiles:
        heard = {
            row["unit"]
            for bus in buses
            for row in bus["units"]
            if one.bus is None or one.bus == bus["bus"]
        }
        if heard and heard.isdisjoint(one.units):
            named = ", ".join(map(str, one.units))
            known = ", ".join(map(str, sorted(heard)))
            yield (
                f"profile {one.profile.name} is for unit {named}, which was not heard;"
                f" there are {known}"
            )


def _copies(buses: list[dict[str, Any]]) -> Iterator[str]:
    """Recordings beside each other of which one, without times, has the requests of the other."""
    if len(buses) > MOST_RECORDINGS:
        return
    for one, other in combinations(buses, 2):
        beside = os.path.dirname(one["bus"]) == os.path.dirname(other["bus"])
        timeless = one["duration_us"] is None or other["duration_us"] is None
        counts = _requests(one)
        if (
            beside
            and timeless
            and counts == _requests(other)
            and sum(counts.values()) >= LEAST_REQUESTS
        ):
            yield (
                f"{one['bus']} and {other['bus']} have the same requests: perhaps one traffic,"
                " counted twice"
            )


def _requests(bus: Mapping[str, Any]) -> dict[tuple[int, int], int]:
    return {(row["unit"], row["function"]): row["transactions"] for row in bus["units"]}


def warn(text: str) -> None:
    """Warn of what is doubtful, at the line of the program that called these packages."""
    frame: FrameType | None = sys._getframe(1)
    depth = 2
    while frame is not None and frame.f_globals.get("__name__", "").startswith("analyzer."):
        frame, depth = frame.f_back, depth + 1
    warnings.warn(text, UserWarning, stacklevel=depth)
