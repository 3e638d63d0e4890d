"""Kinds in which every frame is right and the content is not: spikes, writers, busy devices."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from tests.doctor.case import Case, counter_case, kind, scale
from tests.doctor.frames import exception, rtu
from tests.doctor.kinds.gateways import gateway_on_tcp
from tests.doctor.kinds.silences import share_of
from tests.doctor.line_model import Answer, Exchange, Trouble
from tests.doctor.plant import Poll, random_plant
from tests.doctor.scene import Scene
from tests.doctor.values import counter, smooth


class Spikes(Trouble):
    """Now and then an answer is all FFFF or 0000, or has another block's values."""

    def __init__(self, rng: Random, unit: int, rate: float, style: str) -> None:
        self.rng, self.unit, self.rate, self.style = rng, unit, rate, style
        self._other: dict[int, bytes] = {}

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """With a right checksum."""
        if not answers or exchange.unit != self.unit or exchange.request[1] not in (3, 4):
            return answers
        data = answers[0].data
        length = len(data) - 5
        wrong = self._wrong_values(exchange.poll.address, length)
        self._other[exchange.poll.address] = data[3:-2]
        if wrong is None or self.rng.random() >= self.rate:
            return answers
        exchange.struck = True
        return [replace(answers[0], data=rtu(data[0], data[1:3] + wrong))]

    def _wrong_values(self, address: int, length: int) -> bytes | None:
        if self.style != "other":
            return (b"\xff" if self.style == "ones" else b"\x00") * length
        known = [values for place, values in self._other.items() if place != address]
        return next(((values * length)[:length] for values in known if values), None)


@kind("value_spike")
def value_spike(rng: Random, seed: int) -> Case:
    """Smooth measurements and counters; one answer in some jumps, the neighbours do not."""
    style = ("ones", "zeros", "other")[seed % 3]
    scene = Scene(rng, random_plant(rng, functions=(3,)))
    unit = rng.choice(scene.plant.units)
    table = unit.tables[3]
    for start, size in ((50_000, rng.randint(2, 10)), (51_000, rng.randint(2, 10))):
        table.update(
            {start + place: rng.choice([smooth, smooth, counter])(rng) for place in range(size)}
        )
        scene.plant.polls.append(Poll(unit.address, 3, start, size))
    scene.plant.polls = [
        poll for poll in scene.plant.polls if poll.unit != unit.address or poll.address >= 50_000
    ]
    count, rate = scale(rng, share_of(scene.plant, unit.address))
    scene.run(max(count, 250), Spikes(rng, unit.address, min(rate, 0.15), style))
    return scene.case("value_spike", unit=unit.address)


class Busy(Trouble):
    """A unit refuses with an exception, more often when it was asked a moment ago."""

    def __init__(self, rng: Random, unit: int, code: int, rate: float) -> None:
        self.rng, self.unit, self.code, self.rate = rng, unit, code, rate

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """The exception instead."""
        before = exchange.before
        loaded = before is not None and before.unit == self.unit
        weight = 1.0 if loaded else 0.4
        if not answers or exchange.unit != self.unit or self.rng.random() >= self.rate * weight:
            return answers
        exchange.struck = True
        delay_s = 0.35 if self.code == 11 else answers[0].delay_s
        pdu = exception(exchange.request[1], self.code)
        return [Answer(rtu(self.unit, pdu), delay_s)]


@kind("device_busy")
def device_busy(rng: Random, seed: int) -> Case:
    """Exceptions 5, 6, 10 or 11 at a rate; 11 after a constant delay."""
    code = (6, 11, 5, 10)[seed % 4]
    scene = Scene(rng)
    scene.habits.timeout_s = 1.0
    unit = rng.choice(scene.plant.units).address
    count, rate = scale(rng, share_of(scene.plant, unit) * 0.6, least_rate=0.1)
    scene.run(count, Busy(rng, unit, code, min(rate, 0.8)))
    forbidden = frozenset({"register_hole", "slow_answers", "block_too_long", "wrong_function"})
    return scene.case("device_busy", unit=unit, forbidden=forbidden)


@kind("unexpected_writer")
def unexpected_writer(rng: Random, seed: int) -> Case:
    """The same value is written each cycle for ever; or writes begin amid reading."""
    plant = random_plant(rng, functions=(3,))
    plant.polls = [poll for poll in plant.polls if poll.values is None]
    unit = rng.choice(plant.units)
    address, value = 7_000 + rng.randint(0, 99), rng.randint(0, 4000)
    size = rng.choice([1, 1, 2, 5])
    for place in range(size):
        unit.tables[3][address + place] = lambda _: 0
    function = 6 if size == 1 and rng.random() < 0.7 else 16
    plant.polls.append(Poll(unit.address, function, address, size, lambda _: [value] * size))
    scene = Scene(rng, plant)
    cycles = rng.randint(25, 120)
    write = plant.polls.pop()
    master = scene.master()
    if seed % 2:  # a third of the recording passes before the first write
        master.run(len(plant.polls) * cycles // 3)
    plant.polls.append(write)
    master.run(len(master.exchanges) + len(plant.polls) * cycles)
    return scene.case("unexpected_writer", unit=unit.address)


@kind("gateway_unit_id")
def gateway_unit_id(rng: Random, seed: int) -> Case:
    """A master asks unit 0 (or 255) and another unit number is the one that answers."""
    if seed % 3:
        return gateway_on_tcp(rng, seed)
    plant = random_plant(rng, units=rng.randint(1, 2), functions=(3,))
    unit = plant.units[0]
    plant.polls = [poll for poll in plant.polls if poll.values is None]
    asked = [Poll(0, 3, poll.address, poll.quantity) for poll in plant.polls_of(unit.address)]
    plant.polls = [*asked, *plant.polls[len(asked) // 2 :]]
    scene = Scene(rng, plant)
    scene.habits.retries = 0

    class AnswersForZero(Trouble):
        """Unit 0 is for broadcasts; this unit answers it under its own number."""

        def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
            if exchange.unit:
                return answers
            exchange.struck = True
            pdu = unit.answer(exchange.request[1:-2], exchange.start_s)
            return [Answer(rtu(unit.address, pdu), unit.delay(rng) + 0.005, right=False)]

    scene.run(rng.randint(80, 500), AnswersForZero())
    return scene.case(
        "gateway_unit_id", unit=0, forbidden=frozenset({"dead_unit_cost", "bystander"})
    )


@counter_case("a set point that moves")
def moving_set_point(rng: Random, _seed: int) -> Case:
    """Writes each cycle of values that change are control, not somebody unexpected."""
    plant = random_plant(rng, functions=(3,))
    unit = plant.units[0]
    unit.tables[3][7_000] = lambda _: 0
    signal = smooth(rng)
    plant.polls.append(Poll(unit.address, 6, 7_000, 1, lambda time_s: [signal(time_s)]))
    scene = Scene(rng, plant)
    scene.run(600)
    return scene.case(None, forbidden=frozenset({"unexpected_writer", "value_spike"}))


class RefuseValues(Trouble):
    """A unit that takes values up to a limit, and refuses others with exception 3."""

    def __init__(self, unit: int, function: int, limit: int) -> None:
        self.unit, self.function, self.limit = unit, function, limit

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """The refusal in place of the confirmation."""
        request = exchange.request
        if not answers or exchange.unit != self.unit or request[1] != self.function:
            return answers
        value = int.from_bytes(request[-4:-2], "big")
        if value <= self.limit:
            return answers
        exchange.struck = True
        return [replace(answers[0], data=rtu(self.unit, exception(self.function, 3)))]


@kind("value_refused")
def value_refused(rng: Random, seed: int) -> Case:
    """A setpoint that a unit takes up to a limit, or in some mode only: then it takes none."""
    scene = Scene(rng, random_plant(rng, functions=(3,)))
    unit = rng.choice(scene.plant.units)
    unit.tables[3] |= {40_000 + place: smooth(rng) for place in range(4)}
    function = 6 if seed % 2 else 16
    limit = 0 if seed % 3 == 0 else rng.randint(300, 700)
    values = [rng.randint(1, 1000) for _ in range(50)]
    setpoint = Poll(unit.address, function, 40_001, 1, lambda time_s: [values[int(time_s) % 50]])
    scene.plant.polls.append(setpoint)
    scene.run(len(scene.plant.polls) * 60, RefuseValues(unit.address, function, limit))
    forbidden = frozenset({"block_too_long", "register_hole", "wrong_function", "device_busy"})
    return scene.case(
        "value_refused", unit=unit.address, function=function, address=40_001, forbidden=forbidden
    )
