"""Kinds in which the master's configuration does not fit the unit's register map."""

from __future__ import annotations

from random import Random

from tests.doctor.case import Case, counter_case, kind
from tests.doctor.line_model import Answer, Exchange, Trouble
from tests.doctor.plant import Plant, Poll, Unit, block, polls_for, random_plant
from tests.doctor.scene import Scene
from tests.doctor.values import float_pair, smooth

PROFILE = "profile.toml"


def crowd(rng: Random) -> Plant:
    """A plant whose first unit is the one that is configured wrongly; reads only."""
    plant = random_plant(rng, units=rng.randint(2, 4), functions=rng.choice([(3,), (4,), (3, 4)]))
    plant.polls = [poll for poll in plant.polls if poll.values is None]
    return plant


def finish(scene: Scene, most: int = 700) -> None:
    """Enough cycles, of which each has the trouble in it."""
    cycles = scene.rng.randint(12, 60)
    scene.habits.retries = 0
    scene.run(min(most, max(60, cycles * len(scene.plant.polls))))


@kind("address_off_by_one")
def address_off_by_one(rng: Random, seed: int) -> Case:
    """The block begins one lower than the master thinks: its last register does not exist."""
    plant = crowd(rng)
    unit = plant.units[0]
    function = next(iter(unit.tables))
    first, size = 40_000 + rng.randint(0, 900), rng.randint(2, 12)
    unit.tables[function] |= {first + place: smooth(rng) for place in range(size)}
    plant.polls.append(Poll(unit.address, function, first + 1, size))
    # Somebody has tried the address below, or uses it for a part of the block.
    every = 1 if seed % 2 else 3
    plant.polls.append(Poll(unit.address, function, first, size, every=every))
    scene = Scene(rng, plant)
    finish(scene)
    forbidden = frozenset({"register_hole", "block_too_long", "wrong_function"})
    return scene.case(
        "address_off_by_one",
        unit=unit.address,
        function=function,
        address=first + 1,
        forbidden=forbidden,
    )


@kind("register_hole")
def register_hole(rng: Random, seed: int) -> Case:
    """A block with a register in it that is not there; the parts around it are answered."""
    plant = crowd(rng)
    unit = plant.units[0]
    function = next(iter(unit.tables))
    first, size = 20_000 + rng.randint(0, 900), rng.randint(12, 60)
    unit.tables[function] |= block(rng, first, size)
    hole = first + rng.randint(3, size - 4)
    width = 1 if seed % 2 else rng.randint(1, 2)
    for place in range(hole, hole + width):
        del unit.tables[function][place]
    plant.polls.append(Poll(unit.address, function, first, size))
    below, above = Poll(unit.address, function, first, hole - first), hole + width
    plant.polls += [below, Poll(unit.address, function, above, first + size - above)]
    scene = Scene(rng, plant)
    finish(scene)
    forbidden = frozenset({"block_too_long", "wrong_function", "address_off_by_one"})
    return scene.case("register_hole", unit=unit.address, function=function, forbidden=forbidden)


@kind("block_too_long")
def block_too_long(rng: Random, seed: int) -> Case:
    """Reads beyond a quantity fail, by exception 3, 2 or silence; all shorter ones are answered."""
    plant = crowd(rng)
    unit = plant.units[0]
    function = next(iter(unit.tables))
    limit = rng.choice([16, 32, 50, 61, 64, 100])
    unit.tables[function] |= block(rng, 10_000, 125)
    lengths = [limit + 1, limit + rng.randint(2, 20), limit, limit - 1, limit // 2]
    for length in lengths:
        start = 10_000 + rng.randint(0, 125 - min(125, length))
        plant.polls.append(Poll(unit.address, function, start, min(125, length)))
    unit.longest, unit.too_long = limit, rng.choice([3, 3, 2])
    scene = Scene(rng, plant)
    if seed % 3 == 0:
        scene.habits.retries = 0
        scene.run(len(plant.polls) * rng.randint(12, 40), DropLong(unit.address, limit))
    else:
        finish(scene)
    forbidden = frozenset({"register_hole", "wrong_function", "dead_unit_cost", "polled_too_fast"})
    return scene.case("block_too_long", unit=unit.address, function=function, forbidden=forbidden)


class DropLong(Trouble):
    """A unit whose buffer is too small does not answer at all."""

    def __init__(self, unit: int, limit: int) -> None:
        self.unit, self.limit = unit, limit

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """None to long reads."""
        poll = exchange.poll
        exchange.struck = poll.unit == self.unit and poll.quantity > self.limit
        return [] if exchange.struck else answers


@kind("wrong_function")
def wrong_function(rng: Random, seed: int) -> Case:
    """The same addresses are answered on the other function, of this unit or of its like."""
    function, other = rng.choice([(3, 4), (4, 3)])
    plant = random_plant(rng, units=rng.randint(2, 4), functions=(other,))
    plant.polls = [poll for poll in plant.polls if poll.values is None]
    unit, twin = plant.units[0], plant.units[1]
    first, size = 5_000 + rng.randint(0, 900), rng.randint(2, 30)
    for one in (unit, twin):
        one.tables[other] |= block(rng, first, size)
    plant.polls.append(Poll(unit.address, function, first, size))
    right = twin if seed % 2 else unit
    plant.polls.append(Poll(right.address, other, first, size))
    if seed % 3 == 0:  # the function exists, the addresses do not: exception 2 instead of 1
        unit.tables[function] = block(rng, 0, 10)
        plant.polls.append(Poll(unit.address, function, 0, 8))
    scene = Scene(rng, plant)
    finish(scene)
    forbidden = frozenset({"register_hole", "block_too_long", "address_off_by_one"})
    return scene.case("wrong_function", unit=unit.address, function=function, forbidden=forbidden)


@kind("word_order")
def word_order(rng: Random, seed: int) -> Case:
    """Floats in an order that the profile does not say."""
    real, said = rng.choice(
        [("CDAB", "ABCD"), ("ABCD", "CDAB"), ("DCBA", "ABCD"), ("BADC", "ABCD")]
    )
    plant = crowd(rng)
    unit: Unit = plant.units[0]
    function = 3 if 3 in unit.tables else 4
    first, floats = 3_000 + rng.randint(0, 90), rng.randint(3, 10)
    rows = []
    for place in range(floats):
        low, high = float_pair(rng, real)
        unit.tables[function] |= {first + 2 * place: low, first + 2 * place + 1: high}
        space = "hr" if function == 3 else "ir"
        rows.append(f'{{ name = "f{place}", at = "{space}:{first + 2 * place}", type = "f32" }},')
    plant.polls.append(Poll(unit.address, function, first, 2 * floats))
    scene = Scene(rng, plant)
    finish(scene)
    made = scene.case("word_order", unit=unit.address)
    text = "\n".join(
        [
            "profile = 1",
            "[device]",
            'id = "examined"',
            f'order = "{said}"',
            "address_base = 0",
            "",
        ]
    )
    profile = f"registers = [\n{chr(10).join(rows)}\n]\n" + text
    words = (*made.words, "--profile", f"{unit.address}={PROFILE}")
    files = {**made.files, PROFILE: profile.encode()}
    return Case(files, made.main, words, made.expected)


@counter_case("a float that straddles two quantities")
def straddled_float(rng: Random, _seed: int) -> Case:
    """Every address is one too high: two registers are halves of different floats."""
    plant = crowd(rng)
    unit = plant.units[0]
    function = next(iter(unit.tables))
    first, floats = 3_000, rng.randint(6, 10)
    for place in range(floats):
        low, high = float_pair(rng)
        unit.tables[function] |= {first + 2 * place: low, first + 2 * place + 1: high}
    for place in range(floats - 1):
        plant.polls.append(Poll(unit.address, function, first + 2 * place + 1, 2))
    scene = Scene(rng, plant)
    scene.habits.retries = 0
    scene.run(len(plant.polls) * 40)
    return scene.case("address_off_by_one", unit=unit.address)


@counter_case("an exception now and then")
def rare_exception(rng: Random, _seed: int) -> Case:
    """A tool asks once for what is not there: no register hole to speak of."""
    plant = random_plant(rng, units=3)
    unit = plant.units[0]
    plant.polls.append(Poll(unit.address, 3, 65_000, 4, every=80))
    plant.polls += polls_for(rng, unit)
    scene = Scene(rng, plant)
    scene.run(1200)
    return scene.case(None, forbidden=frozenset({"dead_unit_cost", "line_noise"}))
