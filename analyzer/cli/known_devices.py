"""Which known profiles fit the units of a recording: for `match`, and for a hint below a map."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import _modlens
from analyzer.cli.standard_streams import report
from analyzer.profiles import available_profiles, load
from dissectors.errors import ModlensError
from dissectors.profile import Profile

__all__ = ["ProfileScore", "device_hints", "ranked", "usable_profiles"]

LEAST_REGISTERS = 6
"""A hint is given where at least so many registers were asked for: fewer fit too many devices."""

NAMED = 3


@dataclass(frozen=True, slots=True)
class ProfileScore:
    """How well a profile fits, as `_modlens.Survey.fit` says."""

    percent: int
    bits: float
    """The evidence of the values."""
    share: float
    """The share of the profile's points that were asked for."""
    fits: bool
    reasons: Sequence[str]


def usable_profiles() -> Iterator[Profile]:
    """All available profiles that can be loaded; those with mistakes are reported and skipped."""
    for one in available_profiles():
        try:
            yield load(one.name)
        except ModlensError as error:
            report(f"{one.name} is skipped: {error.message.splitlines()[0]}")


def ranked(
    survey: _modlens.Survey, unit: int, profiles: Iterable[Profile]
) -> list[tuple[ProfileScore, Profile]]:
    """The profiles with their scores for a unit, the best first."""
    scored = []
    for profile in profiles:
        found = json.loads(survey.fit(unit, profile.core))
        scored.append((ProfileScore(**found), profile))
    return sorted(
        scored,
        key=lambda pair: (
            not pair[0].fits, -pair[0].percent, -pair[0].bits, -pair[0].share, pair[1].name
        ),
    )  # fmt: skip


def device_hints(
    survey: _modlens.Survey, tables: Iterable[Mapping[str, Any]], profiles: Sequence[Profile]
) -> Iterator[str]:
    """A sentence for each unit whose registers fit a known device."""
    registers: dict[int, int] = {}
    for table in tables:
        registers[table["unit"]] = registers.get(table["unit"], 0) + table["registers"]
    for unit in sorted(unit for unit, count in registers.items() if count >= LEAST_REGISTERS):
        found = [pair for pair in ranked(survey, unit, profiles) if pair[0].fits]
        if found:
            (best, first), *others = found
            close = [profile.name for score, profile in others if score.percent == best.percent]
            or_else = f", or {', '.join(close[: NAMED - 1])}" if close else ""
            yield (
                f"unit {unit} may be {first.title} ({first.name}, {best.percent} %{or_else}): "
                f"--profile {unit}={first.name} names its registers"
            )
