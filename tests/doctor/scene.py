"""A serial line with all that chance decides before any trouble: settings, plant, habits.

A kind makes a `Scene`, changes what it needs, lets it `run` with its trouble, and returns its
`case`.
"""

from __future__ import annotations

from functools import partial
from random import Random

from analyzer.line import Line
from tests.doctor.case import Case, Expected
from tests.doctor.line_model import Exchange, Habits, Master, Trouble, random_line
from tests.doctor.plant import Plant, random_plant
from tests.doctor.recorded import chunk_log, reads_by_chance
from tests.doctor.views import views_of
from tests.doctor.wire import Pair, Transmission

__all__ = ["Scene"]

CLIENT_DIALECTS = ("pymodbus", "qmodmaster", "wiren-board", "words")


class Scene:
    """One line; `rng` is the only source of chance."""

    def __init__(
        self,
        rng: Random,
        plant: Plant | None = None,
        line: Line | None = None,
        *,
        inverted: bool = False,
    ) -> None:
        """Nothing has been sent yet."""
        self.rng = rng
        self.line = line or random_line(rng)
        self.pair = Pair(self.line, inverted=inverted)
        self.plant = plant or random_plant(rng)
        self.habits = Habits.by_chance(rng)
        self.reads = reads_by_chance(rng)
        self.masters: list[Master] = []
        self.character_s = Transmission(0.0, b"\0", self.line, {}).end_s

    def master(self, trouble: Trouble | None = None, plant: Plant | None = None) -> Master:
        """A (further) master on the line."""
        made = Master(self.pair, plant or self.plant, self.habits, self.rng, trouble)
        self.masters.append(made)
        return made

    def run(self, count: int, trouble: Trouble | None = None) -> list[Exchange]:
        """One master, that many requests at least."""
        return self.master(trouble).run(count)

    def case(  # noqa: PLR0913 - an expectation has that many sides, by keyword
        self,
        code: str | None,
        *,
        unit: int | None = None,
        function: int | None = None,
        address: int | None = None,
        forbidden: frozenset[str] = frozenset(),
        beside: frozenset[str] = frozenset(),
    ) -> Case:
        """The tap's recording, with a gateway's capture and both sides' logs as other views."""
        heard = self.pair.heard()
        words = ("--line", str(self.line)) if self.rng.random() < 0.8 else ()
        files = {"tap.jsonl": chunk_log(heard, self.reads, self.character_s)}
        views = partial(views_of, self.masters[0].exchanges) if len(self.masters) == 1 else dict
        expected = Expected(code, unit, function, address) if code else None
        return Case(files, "tap.jsonl", words, expected, forbidden, beside, views)
