"""Units with their registers, and what a master asks them: the plant on a line.

`plant.units[0].answer(plant.polls[0].pdu(12.0), 12.0)` is the PDU that answers a poll, 12 s after
the beginning.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

from tests.doctor.frames import exception, read_answer, read_request, write_answer, write_request
from tests.doctor.values import Signal, flag, of_any_kind

__all__ = ["Plant", "Poll", "Unit", "block", "random_plant", "random_unit"]

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
READS = (1, 2, 3, 4)
LEGAL_QUANTITY = {1: 2000, 2: 2000, 3: 125, 4: 125}


@dataclass(slots=True)
class Unit:
    """A device: tables by function (5 and 15, 6 and 16 use those of 1 and 3), and how fast it is.

    `delay_s` is the median of its response time, `spread` how widely it varies. `longest` is the
    largest quantity it answers, `refusals` the exception codes of addresses.
    """

    address: int
    tables: dict[int, dict[int, Signal]]
    delay_s: float = 0.01
    spread: float = 0.2
    longest: int = 125
    too_long: int = ILLEGAL_VALUE

    def answer(self, pdu: bytes, time_s: float) -> bytes:
        """The PDU that it answers."""
        function = pdu[0]
        address, quantity = struct.unpack(">HH", pdu[1:5])
        table = self.tables.get({6: 3, 16: 3}.get(function, function))
        if table is None:
            return exception(function, ILLEGAL_FUNCTION)
        if function == 6:
            quantity = 1
        if quantity > (LEGAL_QUANTITY[function] if function in (1, 2) else self.longest):
            return exception(function, self.too_long)
        wanted = range(address, address + quantity)
        if any(place not in table for place in wanted):
            return exception(function, ILLEGAL_ADDRESS)
        if function in READS:
            return read_answer(function, [table[place](time_s) for place in wanted])
        self._store(table, pdu, address)
        return write_answer(pdu)

    def _store(self, table: dict[int, Signal], pdu: bytes, address: int) -> None:
        data = pdu[3:5] if pdu[0] == 6 else pdu[6:]
        for place, (value,) in enumerate(struct.iter_unpack(">H", data)):
            table[address + place] = lambda _, kept=value: kept  # type: ignore[misc]

    def delay(self, rng: Random) -> float:
        """How long it takes this time, in seconds."""
        return self.delay_s * rng.lognormvariate(0, self.spread)


@dataclass(slots=True)
class Poll:
    """One periodic request; `values` makes it a write. Asked every `every`th cycle."""

    unit: int
    function: int
    address: int
    quantity: int
    values: Callable[[float], list[int]] | None = None
    every: int = 1

    def pdu(self, time_s: float) -> bytes:
        """The request at a time."""
        if self.values is not None:
            return write_request(self.function, self.address, self.values(time_s))
        return read_request(self.function, self.address, self.quantity)


@dataclass(slots=True)
class Plant:
    """All units and the poll list of one master."""

    units: list[Unit]
    polls: list[Poll]
    by_address: dict[int, Unit] = field(init=False)

    def __post_init__(self) -> None:
        """Index the units."""
        self.by_address = {unit.address: unit for unit in self.units}

    def polls_of(self, unit: int) -> list[Poll]:
        """The periodic requests to a unit."""
        return [poll for poll in self.polls if poll.unit == unit]


def block(rng: Random, first: int, count: int, bits: bool = False) -> dict[int, Signal]:
    """A block of registers (or bits) of any kind."""
    make = flag if bits else of_any_kind
    return {first + place: make(rng) for place in range(count)}


def random_unit(rng: Random, address: int, functions: tuple[int, ...] = (3, 4)) -> Unit:
    """A unit with one to three blocks for each function."""
    tables: dict[int, dict[int, Signal]] = {}
    for function in functions:
        table: dict[int, Signal] = {}
        for start in rng.sample([0, 100, 256, 1000, 4096, 30_000], rng.randint(1, 2)):
            table |= block(rng, start, rng.choice([10, 24, 40, 60]), bits=function in (1, 2))
        tables[function] = table
    return Unit(address, tables, rng.choice([0.003, 0.006, 0.012, 0.025, 0.05]))


def polls_for(rng: Random, unit: Unit, most: int = 3) -> list[Poll]:
    """Reads of blocks that exist; each function at least once."""
    polls = []
    for function, table in unit.tables.items():
        starts = sorted(place for place in table if place - 1 not in table)
        for start in starts[:most]:
            room = next(size for size in range(1, 126) if start + size not in table)
            inset = rng.randint(0, min(4, room - 1))
            quantity = rng.randint(1, min(room - inset, 40))
            polls.append(Poll(unit.address, function, start + inset, quantity))
    return polls


def random_plant(
    rng: Random, *, units: int | None = None, functions: tuple[int, ...] | None = None
) -> Plant:
    """Two to five units, polled in a fixed order, with a set point written now and then."""
    count = units or rng.randint(2, 5)
    addresses = sorted(rng.sample(range(1, 32), count))
    kinds = [(3,), (4,), (3, 4), (3, 1), (4, 2)]
    made = [random_unit(rng, address, functions or rng.choice(kinds)) for address in addresses]
    polls = [poll for unit in made for poll in polls_for(rng, unit)]
    writable = [unit for unit in made if 3 in unit.tables]
    if writable and rng.random() < 0.4:
        polls.append(set_point(rng, rng.choice(writable)))
    return Plant(made, polls)


def set_point(rng: Random, unit: Unit) -> Poll:
    """A write every few cycles, of a value that moves."""
    address = 8000 + rng.randint(0, 50)
    unit.tables[3][address] = lambda _: 0
    every, step = rng.randint(4, 9), rng.uniform(2, 20)
    return Poll(unit.address, 6, address, 1, lambda time_s: [200 + int(time_s / step)], every)
