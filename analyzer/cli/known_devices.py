"""Which known profiles fit the units of a recording: for `match`, and for a hint below a map."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from analyzer.cli.standard_streams import report
from analyzer.profiles import available_profiles, load
from dissectors.errors import ModlensError
from dissectors.profile import Profile
from dissectors.profile_learning import ProfileScore, score_profile

__all__ = ["device_hints", "ranked", "usable_profiles"]

Tables = Sequence[Mapping[str, Any]]

LEAST_REGISTERS = 6
"""A hint is given where at least so many registers were asked for: fewer fit too many devices."""

NAMED = 3


def usable_profiles() -> Iterator[Profile]:
    """All available profiles that can be loaded; those with mistakes are reported and skipped."""
    for one in available_profiles():
        try:
            yield load(one.name)
        except ModlensError as error:
            report(f"{one.name} is skipped: {error.message.splitlines()[0]}")


def ranked(tables: Tables, profiles: Iterable[Profile]) -> list[tuple[ProfileScore, Profile]]:
    """The profiles with their scores for a unit's tables, the best first."""
    scored = [(score_profile(tables, profile), profile) for profile in profiles]
    return sorted(scored, key=lambda pair: (-pair[0].points, -pair[0].share, pair[1].name))


def device_hints(tables: Tables, profiles: Sequence[Profile]) -> Iterator[str]:
    """A sentence for each unit whose registers fit a known device."""
    for unit in sorted({table["unit"] for table in tables}):
        own = [table for table in tables if table["unit"] == unit]
        if sum(len(table["registers"]) for table in own) < LEAST_REGISTERS:
            continue
        found = [(score, profile) for score, profile in ranked(own, profiles) if score.fits]
        if found:
            (best, first), *others = found
            close = [profile.name for score, profile in others if score.points == best.points]
            or_else = f", or {', '.join(close[: NAMED - 1])}" if close else ""
            yield (
                f"unit {unit} may be {first.title} ({first.name}, {best.points} %{or_else}): "
                f"--profile {unit}={first.name} names its registers"
            )
