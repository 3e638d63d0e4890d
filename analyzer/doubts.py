"""Sentences about a run whose recordings and settings can hardly be meant so."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from types import FrameType
from typing import Any

from analyzer.addresses import SHORT
from analyzer.settings import Settings
from dissectors.errors import ModlensWarning

__all__ = ["doubts", "warn"]

_LEAST_TRANSACTIONS = 20


def doubts(settings: Settings, statistics: Mapping[str, Any]) -> Iterator[str]:
    """What to say at the end of a run about its settings and recordings, one sentence each."""
    if not settings.select:
        yield from _unheard(settings, statistics["buses"])
        yield from _unnamed(settings, statistics["buses"])
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


def _unnamed(settings: Settings, buses: list[dict[str, Any]]) -> Iterator[str]:
    """Profiles that name nothing of what was read: a device may have it under another function."""
    for one in settings.profiles:
        of_profile = _places(one.profile.points)
        polls = [bus["polls"] for bus in buses if one.bus is None or one.bus == bus["bus"]]
        asked = [row for found in polls for row in found["requests"] if row["unit"] in one.units]
        asked = [row for row in asked if row["register_type"] and row["address"] is not None]
        if not of_profile or not asked or any(found["more"] for found in polls):
            continue
        read = {(SHORT[row["register_type"]], at) for row in asked for at in _addresses(row)}
        if read.isdisjoint(of_profile):
            yield (
                f"profile {one.profile.name} names nothing of what was read: it has"
                f" {_ranges(of_profile)}, and unit {', '.join(map(str, one.units))} was asked for"
                f" {_ranges(read)}"
            )


def _places(points: Iterable[Mapping[str, Any]]) -> set[tuple[str, int]]:
    """The types and addresses of points; empty where one has no fixed place."""
    places = set()
    for point in points:
        kind, _, address = str(point.get("at", "")).partition(":")
        if kind not in SHORT.values() or not address.isdecimal():
            return set()
        places.add((kind, int(address)))
    return places


def _addresses(row: Mapping[str, Any]) -> range:
    return range(row["address"], row["address"] + (row["quantity"] or 1))


def _ranges(places: set[tuple[str, int]]) -> str:
    """The first and last address of each type.

    >>> _ranges({("ir", 4), ("ir", 0), ("hr", 7)})
    'hr 7, ir 0-4'
    """
    kinds: dict[str, list[int]] = {}
    for kind, address in sorted(places):
        kinds.setdefault(kind, []).append(address)
    return ", ".join(
        f"{kind} {found[0]}" + (f"-{found[-1]}" if found[1:] else "")
        for kind, found in kinds.items()
    )


def _copies(buses: list[dict[str, Any]]) -> Iterator[str]:
    """Recordings with times, and beside them others without times that have the same requests."""
    alike: dict[tuple[str, frozenset[Any]], list[dict[str, Any]]] = {}
    for bus in buses:
        if sum(row["transactions"] for row in bus["units"]) >= _LEAST_TRANSACTIONS:
            counts = ((row["unit"], row["function"], row["transactions"]) for row in bus["units"])
            alike.setdefault((os.path.dirname(bus["bus"]), frozenset(counts)), []).append(bus)
    copies = [
        " and ".join(bus["bus"] for bus in group)
        for group in alike.values()
        if len({bus["duration_us"] is None for bus in group}) > 1
    ]
    if copies:
        more = f" (and {len(copies) - 1} more such pairs)" if copies[1:] else ""
        yield f"{copies[0]}{more} have the same requests: perhaps one traffic, counted twice"


def warn(text: str) -> None:
    """Warn of what is doubtful, at the line of the program that called these packages."""
    frame: FrameType | None = sys._getframe(1)
    depth = 2
    while frame is not None and frame.f_globals.get("__name__", "").startswith("analyzer."):
        frame, depth = frame.f_back, depth + 1
    warnings.warn(text, ModlensWarning, stacklevel=depth)
