"""Kinds in which answers are late or missing: slow, too fast, dead, absent, saturated."""

from __future__ import annotations

from dataclasses import replace
from random import Random
from statistics import NormalDist

from tests.doctor.case import Case, counter_case, kind, scale
from tests.doctor.line_model import Answer, Exchange, Habits, Trouble, random_line
from tests.doctor.plant import Plant, Poll, block, random_plant
from tests.doctor.scene import Scene


def share_of(plant: Plant, unit: int) -> float:
    """The share of requests that go to a unit."""
    weights = {id(poll): 1 / poll.every for poll in plant.polls}
    own = sum(weights[id(poll)] for poll in plant.polls_of(unit))
    return own / sum(weights.values())


def make_slow(scene: Scene, rate: float) -> int:
    """Make one unit answer later than the timeout at that rate; its address."""
    rng = scene.rng
    unit = rng.choice(scene.plant.units)
    unit.spread = rng.uniform(0.2, 0.5)
    later = NormalDist().inv_cdf(1 - min(rate, 0.9))
    unit.delay_s = scene.habits.timeout_s / 2.718281828 ** (unit.spread * later)
    return unit.address


@kind("slow_answers")
def slow_answers(rng: Random, _seed: int) -> Case:
    """One unit's response times reach beyond the master's timeout; the answers exist."""
    scene = Scene(rng)
    scene.habits.timeout_s = rng.choice([0.1, 0.2, 0.3, 0.5, 1.0])
    # An answer that comes before the next request looks like one in time; without pauses between
    # cycles, a part of them does not.
    scene.habits.pauses_s, scene.habits.period_s = (rng.uniform(0.004, 0.02),), 0.0
    share = min(share_of(scene.plant, unit.address) for unit in scene.plant.units)
    count, rate = scale(rng, share)
    unit = make_slow(scene, rate)
    scene.run(count)
    return scene.case("slow_answers", unit=unit, forbidden=frozenset({"dead_unit_cost"}))


class TooFast(Trouble):
    """A unit is deaf for a while after other traffic on the line."""

    def __init__(self, unit: int, need_s: float, after_others_only: bool) -> None:
        self.unit, self.need_s, self.after_others_only = unit, need_s, after_others_only

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """None where the silence was too short."""
        before = exchange.before
        same = before is not None and before.unit == exchange.unit
        fast = exchange.silence_s < self.need_s and not (same and self.after_others_only)
        exchange.struck = exchange.unit == self.unit and fast
        return [] if exchange.struck else answers


@kind("polled_too_fast")
def polled_too_fast(rng: Random, seed: int) -> Case:
    """One unit does not answer what comes too soon after the frame before."""
    scene = Scene(rng)
    short, need = rng.uniform(0.004, 0.01), rng.uniform(0.02, 0.04)
    unit = rng.choice(scene.plant.units).address
    share = share_of(scene.plant, unit)
    count, rate = scale(rng, share, least_rate=0.1)
    shorts = max(1, round(rate * 20))
    longs = max(3, 20 - shorts)
    scene.habits.pauses_s = tuple(
        [short] * shorts + [need * rng.uniform(1.3, 2.5) for _ in range(longs)]
    )
    scene.habits.retries, scene.habits.period_s = 0, 0.0
    scene.run(count, TooFast(unit, need, after_others_only=seed % 2 == 0))
    return scene.case(
        "polled_too_fast", unit=unit, forbidden=frozenset({"dead_unit_cost", "device_absent"})
    )


class Dead(Trouble):
    """A unit never answers; whoever is asked after it may be silent as well."""

    def __init__(self, rng: Random, unit: int, poison: float) -> None:
        self.rng, self.unit, self.poison = rng, unit, poison

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """None of the dead one, and sometimes none after it."""
        before = exchange.before
        after = before is not None and before.unit == self.unit and exchange.unit != self.unit
        poisoned = after and self.rng.random() < self.poison
        exchange.struck = exchange.unit == self.unit or poisoned
        return [] if exchange.struck else answers


@kind("dead_unit_cost")
def dead_unit_cost(rng: Random, seed: int) -> Case:
    """A unit on the poll list is not there; each cycle waits for it."""
    scene = Scene(rng)
    unit = rng.choice(scene.plant.units).address
    count, _ = scale(rng, share_of(scene.plant, unit))
    poison = 0.0 if seed % 2 else rng.uniform(0.3, 0.9)
    scene.run(count, Dead(rng, unit, poison))
    forbidden = frozenset({"slow_answers", "device_absent", "polled_too_fast"})
    return scene.case("dead_unit_cost", unit=unit, forbidden=forbidden)


class Away(Trouble):
    """A unit is off between moments, and restarts when it comes back."""

    def __init__(self, unit: int, runs: list[tuple[int, int]]) -> None:
        self.unit, self.runs = unit, runs

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """None while it is off."""
        off = any(first <= exchange.number < last for first, last in self.runs)
        exchange.struck = off and exchange.unit == self.unit
        return [] if exchange.struck else answers


@kind("device_absent")
def device_absent(rng: Random, _seed: int) -> Case:
    """A unit answers for a long time, is silent for a run, and answers again."""
    scene = Scene(rng)
    unit = rng.choice(scene.plant.units).address
    count, _ = scale(rng, share_of(scene.plant, unit), least_rate=0.3)
    count = max(count, 200)
    runs = []
    for turn in range(rng.randint(1, 3)):
        first = round(count * (0.1 + 0.3 * turn + rng.uniform(0, 0.08)))
        runs.append((first, first + round(count * rng.uniform(0.07, 0.2))))
    scene.run(count, Away(unit, runs))
    forbidden = frozenset({"dead_unit_cost", "slow_answers", "polled_too_fast"})
    return scene.case("device_absent", unit=unit, forbidden=forbidden)


@kind("bus_saturated")
def bus_saturated(rng: Random, _seed: int) -> Case:
    """Long blocks at a low rate, without a pause: the line is never free."""
    line = random_line(rng, fastest=19_200)
    plant = random_plant(rng, units=rng.randint(3, 5), functions=(3, 4))
    for unit in plant.units:
        unit.delay_s = rng.uniform(0.003, 0.006)
        unit.tables[3] |= block(rng, 60_000, 125)
        plant.polls.append(Poll(unit.address, 3, 60_000, rng.randint(60, 125)))
        plant.polls.append(Poll(unit.address, 3, 60_000, rng.randint(60, 125)))
    scene = Scene(rng, plant, line)
    scene.habits = Habits(timeout_s=1.0, pauses_s=(0.0045,))
    scene.run(rng.randint(100, 600))
    made = scene.case("bus_saturated")  # whoever wants to know the load says the rate
    return replace(made, words=("--line", str(line)))


@counter_case("a long block after a short time-out, dead unit beside")
def slow_beside_dead(rng: Random, _seed: int) -> Case:
    """A slow unit is distinguished from a dead one: both are there, each by its name."""
    scene = Scene(rng, random_plant(rng, units=4))
    scene.habits.retries = 0
    slow = make_slow(scene, 0.3)
    dead = next(unit.address for unit in scene.plant.units if unit.address != slow)
    scene.run(800, Dead(rng, dead, 0.0))
    return scene.case("slow_answers", unit=slow, beside=frozenset({"dead_unit_cost"}))
