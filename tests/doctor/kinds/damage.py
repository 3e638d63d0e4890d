"""Kinds in which frames are damaged: noise, strays, drivers, two units, two masters, pauses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from random import Random

from tests.doctor.case import Case, counter_case, kind, scale
from tests.doctor.frames import rtu
from tests.doctor.kinds.silences import share_of
from tests.doctor.line_model import Answer, Exchange, Trouble, together
from tests.doctor.plant import Plant, Unit, polls_for, random_plant, random_unit
from tests.doctor.scene import Scene

STRAYS = (b"\x00", b"\x00", b"\xff", b"\xfe", b"\x00\x00", b"\xff\xfe", b"\xf8")


def flip(rng: Random, data: bytes, most: int = 4) -> bytes:
    """Invert one to `most` bits anywhere."""
    damaged = bytearray(data)
    for _ in range(rng.randint(1, most)):
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged) if bytes(damaged) != data else flip(rng, data, most)


class Noise(Trouble):
    """Bits are flipped anywhere in the frames of all (or nearly only of some), at a rate."""

    def __init__(self, rng: Random, rate: float, near: int | None = None) -> None:
        self.rng, self.rate, self.near = rng, rate, near

    def _strikes(self, exchange: Exchange, answer: bool) -> bool:
        weight = 1.0 if self.near is None else 1.0 if self._near(exchange, answer) else 0.06
        struck = self.rng.random() < self.rate * weight
        exchange.struck = exchange.struck or struck
        return struck

    def _near(self, exchange: Exchange, answer: bool) -> bool:
        return exchange.unit == self.near and answer

    def request(self, exchange: Exchange) -> bytes:
        """Sometimes damaged."""
        return (
            flip(self.rng, exchange.request) if self._strikes(exchange, False) else exchange.request
        )

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """Sometimes damaged."""
        return [
            replace(one, data=flip(self.rng, one.data), right=False)
            if self._strikes(exchange, True)
            else one
            for one in answers
        ]


class NoiseAfterWrites(Noise):
    """A motor is switched by the write, and disturbs the line for a while."""

    def __init__(self, rng: Random, rate: float, lasts_s: float) -> None:
        super().__init__(rng, rate)
        self.lasts_s = lasts_s

    def _strikes(self, exchange: Exchange, answer: bool) -> bool:
        since_s = exchange.start_s - exchange.write_s
        return since_s < self.lasts_s and super()._strikes(exchange, answer)


@kind("line_noise")
def line_noise(rng: Random, seed: int) -> Case:
    """Flipped bits anywhere, both directions, all units; every third seed after writes only."""
    scene = Scene(rng)
    count, rate = scale(rng, 1.0)
    rate = min(rate, 0.5)
    trouble = Noise(rng, rate)
    if seed % 3 == 0:
        scene = Scene(rng, with_writes(rng, random_plant(rng)))
        count, trouble = max(count, 800), NoiseAfterWrites(rng, max(rate, 0.4), 0.3)
    scene.run(count, trouble)
    forbidden = frozenset({"duplicate_address", "two_masters", "driver_enable", "no_bias"})
    return scene.case("line_noise", forbidden=forbidden)


def with_writes(rng: Random, plant: Plant) -> Plant:
    """The same with a write every other cycle."""
    unit = plant.units[0]
    unit.tables.setdefault(3, {})[9000] = lambda _: 0
    poll = replace(plant.polls[0], unit=unit.address, function=6, address=9000, quantity=1)
    poll.values, poll.every = (lambda time_s: [int(time_s * 7) % 1000]), rng.randint(2, 4)
    plant.polls.insert(0, poll)
    return plant


@counter_case("noise near one unit")
def noise_near_one_unit(rng: Random, _seed: int) -> Case:
    """Bits anywhere in one unit's answers, others a little as well."""
    scene = Scene(rng, random_plant(rng, units=rng.randint(3, 4)))
    near = rng.choice(scene.plant.units).address
    scene.run(900, Noise(rng, rng.uniform(0.3, 0.6), near))
    forbidden = frozenset({"duplicate_address", "driver_enable", "wrong_line_settings"})
    return scene.case("line_noise", forbidden=forbidden)


class Strays(Trouble):
    """Stray characters where the line turns round."""

    def __init__(self, rng: Random, rate: float, side: str, unit: int | None) -> None:
        self.rng, self.rate, self.side, self.unit = rng, rate, side, unit
        self.stray = rng.sample(STRAYS, 2)

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """The answer with strays in front of it or after it."""
        concerned = self.unit in (None, exchange.unit)
        if not answers or not concerned or self.rng.random() >= self.rate:
            return answers
        exchange.struck = True
        stray, one = self.rng.choice(self.stray), answers[0]
        pause = self.rng.choice([0.0, 0.0, 0.0004])
        if self.side == "before":
            hurts = self.rng.random() < 0.4
            return [
                replace(one, data=stray + one.data, pauses={len(stray): pause}, right=not hurts)
            ]
        return [replace(one, data=one.data + stray, pauses={len(one.data): pause})]


@kind("no_bias")
def no_bias(rng: Random, seed: int) -> Case:
    """00, FF, FE around answers; every second seed with one unit only."""
    scene = Scene(rng)
    unit = rng.choice(scene.plant.units).address if seed % 2 else None
    share = 1.0 if unit is None else share_of(scene.plant, unit)
    count, rate = scale(rng, share, least_rate=0.1)
    scene.run(count, Strays(rng, rate, rng.choice(["before", "after"]), unit))
    forbidden = frozenset({"line_noise", "duplicate_address", "two_masters"})
    return scene.case("no_bias", unit=unit, forbidden=forbidden)


class LateDriver(Trouble):
    """The first bytes of a unit's answers are lost where it answers soon."""

    def __init__(self, rng: Random, unit: int, hold_s: float) -> None:
        self.rng, self.unit, self.hold_s = rng, unit, hold_s

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """Damaged at the front, if the other driver still held the line."""
        concerned = answers and exchange.unit == self.unit
        if not concerned or answers[0].delay_s >= self.hold_s:
            return answers
        exchange.struck = True
        data = bytearray(answers[0].data)
        lost = self.rng.randint(1, 2)
        if self.rng.random() < 0.5:
            data[:lost] = bytes(self.rng.choice([0xFF, 0xC5, 0xE0, 0x7E]) for _ in range(lost))
        else:
            del data[:lost]
        return [replace(answers[0], data=bytes(data), right=False)]


class EarlyDriver(Trouble):
    """The master's driver is switched off before the last byte is out, sometimes."""

    def __init__(self, rng: Random, rate: float) -> None:
        self.rng, self.rate = rng, rate

    def request(self, exchange: Exchange) -> bytes:
        """One byte short, or its last byte half gone."""
        if self.rng.random() >= self.rate:
            return exchange.request
        exchange.struck = True
        if self.rng.random() < 0.7:
            return exchange.request[:-1]
        return exchange.request[:-1] + bytes([exchange.request[-1] | 0xF0])


@kind("driver_enable")
def driver_enable(rng: Random, seed: int) -> Case:
    """Answers without their first bytes after short turnarounds; or requests without their last."""
    scene = Scene(rng, random_plant(rng, units=rng.randint(2, 4)))
    if seed % 3 == 0:
        count, rate = scale(rng, 1.0)
        scene.run(count, EarlyDriver(rng, rate))
        return scene.case("driver_enable", forbidden=frozenset({"line_noise", "bus_saturated"}))
    unit = rng.choice(scene.plant.units)
    unit.spread = rng.uniform(0.6, 1.0)
    unit.delay_s = max(unit.delay_s, 0.006)
    count, rate = scale(rng, share_of(scene.plant, unit.address), least_rate=0.15)
    samples = sorted(max(unit.delay(rng), 0.0045) for _ in range(400))
    hold_s = samples[min(399, int(min(rate, 0.7) * 400))] + 0.001
    scene.run(count, LateDriver(rng, unit.address, hold_s))
    forbidden = frozenset({"duplicate_address", "line_noise", "no_bias", "wrong_line_settings"})
    return scene.case("driver_enable", unit=unit.address, forbidden=forbidden)


class Twins(Trouble):
    """Two units with one address answer at nearly the same time; their values differ."""

    def __init__(self, rng: Random, unit: int, other: Unit, apart_s: float, rate: float) -> None:
        self.rng, self.unit, self.other = rng, unit, other
        self.apart_s, self.rate = apart_s, rate

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """Both."""
        if not answers or exchange.unit != self.unit or self.rng.random() >= self.rate:
            return answers
        exchange.struck = True
        pdu = self.other.answer(exchange.request[1:-2], exchange.start_s)
        delay_s = answers[0].delay_s + abs(self.rng.gauss(0, self.apart_s))
        first = replace(answers[0], right=False)
        return [first, Answer(rtu(self.unit, pdu), delay_s, right=False)]


@kind("duplicate_address")
def duplicate_address(rng: Random, _seed: int) -> Case:
    """Answers of one unit are two at once."""
    scene = Scene(rng, random_plant(rng, units=rng.randint(2, 4)))
    unit = rng.choice(scene.plant.units)
    other = random_unit(rng, unit.address, tuple(unit.tables))
    for function, table in unit.tables.items():
        fresh = random_unit(rng, unit.address, (function,)).tables[function]
        values = list(fresh.values())
        other.tables[function] = {
            place: values[turn % len(values)] for turn, place in enumerate(table)
        }
    unit.spread = 0.05
    count, rate = scale(rng, share_of(scene.plant, unit.address), least_rate=0.85)
    apart_s = rng.uniform(0.05, 2.0) * scene.character_s
    scene.run(count, Twins(rng, unit.address, other, apart_s, rate))
    forbidden = frozenset({"line_noise", "driver_enable", "wrong_line_settings", "no_bias"})
    return scene.case("duplicate_address", unit=unit.address, forbidden=forbidden)


@kind("two_masters")
def two_masters(rng: Random, _seed: int) -> Case:
    """Two masters with cycles of their own; where they meet, both are damaged."""
    scene = Scene(rng, random_plant(rng, units=rng.randint(2, 4)))
    scene.habits.period_s = rng.choice([0.5, 1.0, 2.0])
    scene.habits.retries = 0
    scene.habits.timeout_s = 0.2
    first = scene.master()
    picked = rng.sample(scene.plant.units, rng.randint(1, len(scene.plant.units)))
    polls = [poll for unit in picked for poll in polls_for(rng, unit)]
    second = scene.master(plant=Plant(scene.plant.units, polls))
    second.habits = replace(scene.habits, period_s=scene.habits.period_s * rng.uniform(0.6, 1.7))
    second.now_s = rng.uniform(0, 1)
    together([first, second], rng.randint(300, 1500))
    forbidden = frozenset({"line_noise", "duplicate_address", "own_echo"})
    return scene.case("two_masters", forbidden=forbidden)


class Choppy(Trouble):
    """A sender pauses inside its frames; a receiver that keeps t1.5 gives such a frame up."""

    def __init__(self, rng: Random, rate: float, unit: int | None, fatal: float) -> None:
        self.rng, self.rate, self.unit, self.fatal = rng, rate, unit, fatal

    def _pauses(self, length: int) -> Mapping[int, float]:
        places = self.rng.sample(range(2, length), min(self.rng.randint(1, 2), length - 2))
        return {place: self.rng.uniform(0.006, 0.045) for place in places}

    def request_pauses(self, exchange: Exchange) -> Mapping[int, float]:
        """A master on a user-space serial driver."""
        if self.unit is None and self.rng.random() < self.rate:
            exchange.struck = True
            return self._pauses(len(exchange.request))
        return {}

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """None after a request in blocks; or answers in blocks, which the master drops."""
        if exchange.struck:
            return [] if self.rng.random() < self.fatal else answers
        concerned = answers and exchange.unit == self.unit and self.rng.random() < self.rate
        if not concerned:
            return answers
        exchange.struck = True
        hurts = self.rng.random() < self.fatal
        pauses = self._pauses(len(answers[0].data))
        return [replace(answers[0], pauses=pauses, right=not hurts)]


@kind("gaps_in_frames")
def gaps_in_frames(rng: Random, seed: int) -> Case:
    """Pauses inside the requests, or inside one unit's answers."""
    scene = Scene(rng)
    unit = None if seed % 2 else rng.choice(scene.plant.units).address
    share = 1.0 if unit is None else share_of(scene.plant, unit)
    count, rate = scale(rng, share, least_rate=0.15)
    scene.run(count, Choppy(rng, rate, unit, rng.uniform(0.6, 1.0)))
    forbidden = frozenset({"line_noise", "slow_answers", "polled_too_fast"})
    return scene.case("gaps_in_frames", unit=unit, forbidden=forbidden)
