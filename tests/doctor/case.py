"""A case: recordings of one trouble (or of none), and what a good diagnosis would say of them.

Kinds are functions that make the recordings of a seed; `kind` enters them into `KINDS`, and
`counter_case` into `COUNTER_CASES`: near confusions, where the expected code is the neighbour's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random

__all__ = ["COUNTER_CASES", "KINDS", "Case", "Expected", "counter_case", "kind", "make", "scale"]

FEWEST, MOST = 60, 2000
ENOUGH = 20
"""As many times at least the trouble strikes, unless a kind says otherwise."""


@dataclass(frozen=True, slots=True)
class Expected:
    """The code that has to be there, and its subject as far as it has one."""

    code: str
    unit: int | None = None
    function: int | None = None
    address: int | None = None
    client: str | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """Recordings by name, `main` the one to examine with these words after the command.

    `expected` is None for a healthy line. `forbidden` are the codes that would be a confusion;
    `beside` those that are true here as well. `views` makes other recordings of the same traffic,
    which need no words.
    """

    files: Mapping[str, bytes]
    main: str
    words: tuple[str, ...]
    expected: Expected | None
    forbidden: frozenset[str] = frozenset()
    beside: frozenset[str] = frozenset()
    views: Callable[[], Mapping[str, bytes]] = field(default=dict, compare=False)


Maker = Callable[[Random, int], Case]

KINDS: dict[str, Maker] = {}
COUNTER_CASES: dict[str, Maker] = {}


def kind(code: str) -> Callable[[Maker], Maker]:
    """Enter a maker as the one of a code."""

    def enter(maker: Maker) -> Maker:
        KINDS[code] = maker
        return maker

    return enter


def counter_case(name: str) -> Callable[[Maker], Maker]:
    """Enter a maker of a near confusion."""

    def enter(maker: Maker) -> Maker:
        COUNTER_CASES[name] = maker
        return maker

    return enter


def make(name: str, seed: int) -> Case:
    """The case of a kind or counter-case; KeyError for an unknown name."""
    maker = KINDS.get(name) or COUNTER_CASES[name]
    return maker(Random(f"{name}:{seed}"), seed)


def scale(rng: Random, share: float = 1.0, *, least_rate: float = 0.05) -> tuple[int, float]:
    """A number of transactions, and the rate at which trouble strikes the `share` it can strike.

    Few transactions come with high rates: below `ENOUGH` strikes nobody can tell a cause.
    """
    rate = math.exp(rng.uniform(math.log(least_rate), 0))
    count = int(math.exp(rng.uniform(math.log(FEWEST), math.log(MOST))))
    needed = math.ceil(ENOUGH / (rate * share))
    if needed > MOST:
        rate = min(1.0, ENOUGH / (MOST * share))
    return min(MOST, max(count, needed)), rate
