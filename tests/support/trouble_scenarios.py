"""Lines with one trouble each, played by real pymodbus masters and units on a pty bus.

What a device or an adapter does wrong is played by the device's own action, or by the bus where it
is a matter of wires and power. Each is small: some dozens of transactions.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from pymodbus.client import ModbusSerialClient
from pymodbus.constants import ExcCodes
from pymodbus.simulator import DataType, SimAction, SimData, SimDevice

from tests.support.pymodbus_buses import BusScenario

__all__ = [
    "absent",
    "busy",
    "dead",
    "hole",
    "late_driver",
    "off_by_one",
    "saturated",
    "slow",
    "spikes",
    "strays",
    "too_fast",
    "too_long",
    "two_with_one_address",
    "writer",
    "wrong_function",
]

Steps = Iterator[Callable[[], object]]
Act = Callable[[int], ExcCodes | None]
"""What a device does before it reads: it gets the quantity, and refuses if it likes to."""

FOUR_WIRE = {name: ["master"] for name in ("unit1", "unit2", "unit3", "twin")}


@dataclass(frozen=True, slots=True)
class Manner:
    """What a device does in its own way.

    It lacks holding register `gap`, gives FFFF in all registers of each `spikes`th read, works on a
    request for `works_s`, in turn, and adds `shift` to its values. `act` may refuse a request.
    """

    act: Act | None = None
    gap: int = 0
    spikes: int = 0
    works_s: Sequence[float] = (0.0,)
    shift: int = 0


def device(unit: int, manner: Manner | None = None) -> SimDevice:
    """Registers 0 to 59 that move, 16 coils and inputs; input registers 100 to 119 as well."""
    like = manner or Manner()
    work_s = itertools.cycle(like.works_s)
    reads = itertools.count()

    async def action(  # noqa: PLR0913, PLR0917 - pymodbus calls it so
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        await asyncio.sleep(next(work_s))
        if function in {3, 4} and values is None:
            now = next(reads)
            for place in range(address, address + count):
                wave = round(40 * math.sin(now / 9 + place / 3))
                spike = like.spikes and now % like.spikes == like.spikes - 1
                registers[place - start] = (
                    0xFFFF if spike else 2000 + like.shift + 37 * place + wave
                )
        return like.act(count) if like.act else None

    gap = like.gap
    own = [_registers(0, gap or 60), *([_registers(gap + 1, 59 - gap)] if gap else [])]
    bits = [SimData(0, values=[True, False] * 8, datatype=DataType.BITS)]
    inputs = [_registers(0, 60), _registers(100, 20)]
    return SimDevice(unit, simdata=(bits, bits, own, inputs), action=_typed(action))


def _typed(action: object) -> SimAction:
    return action  # type: ignore[return-value]


def _registers(first: int, count: int) -> SimData:
    return SimData(first, values=list(range(count)), datatype=DataType.REGISTERS)


def line_of(
    units: Mapping[str, SimDevice],
    script: Callable[[ModbusSerialClient], Steps],
    disturb: Callable[[str, bytes], bytes] | None = None,
) -> BusScenario:
    """A four-wire line at 57600 baud with a master that waits 150 ms and asks once."""
    hears = {name: heard for name, heard in FOUR_WIRE.items() if name in units}
    return BusScenario(
        units,
        script,
        baud=57600,
        trigger=14,
        hears=hears,
        disturb=disturb,
        timeout_s=0.15,
        retries=0,
    )


def cycle(client: ModbusSerialClient, turns: int, *reads: tuple[int, int, int, int]) -> Steps:
    """Reads of (unit, function, address, count), again and again."""
    for _ in range(turns):
        for unit, function, address, count in reads:
            read = client.read_holding_registers if function == 3 else client.read_input_registers
            yield partial(read, address, count=count, device_id=unit)


def _plain(
    *reads: tuple[int, int, int, int], turns: int = 20
) -> Callable[[ModbusSerialClient], Steps]:
    return lambda client: cycle(client, turns, *reads)


def _three() -> dict[str, SimDevice]:
    return {f"unit{unit}": device(unit) for unit in (1, 2, 3)}


def hole() -> BusScenario:
    units = {"unit1": device(1, Manner(gap=23)), "unit2": device(2)}
    reads = ((1, 3, 10, 30), (2, 3, 0, 10), (1, 3, 10, 13), (1, 3, 24, 16))
    return line_of(units, _plain(*reads))


def too_long() -> BusScenario:
    def act(count: int) -> ExcCodes | None:
        return ExcCodes.ILLEGAL_VALUE if count > 32 else None

    units = {"unit1": device(1, Manner(act)), "unit2": device(2)}
    reads = ((1, 3, 0, 40), (1, 3, 0, 32), (2, 3, 0, 40), (1, 3, 8, 33), (1, 3, 20, 12))
    return line_of(units, _plain(*reads))


def off_by_one() -> BusScenario:
    reads = ((1, 3, 50, 11), (1, 3, 10, 6), (1, 3, 49, 11), (2, 3, 0, 10))
    return line_of({"unit1": device(1), "unit2": device(2)}, _plain(*reads))


def wrong_function() -> BusScenario:
    reads = ((1, 3, 100, 12), (1, 4, 100, 12), (1, 3, 0, 10), (2, 3, 0, 10))
    return line_of({"unit1": device(1), "unit2": device(2)}, _plain(*reads))


def busy() -> BusScenario:
    last_s = {"at": 0.0}

    def act(_count: int) -> ExcCodes | None:
        before_s, last_s["at"] = last_s["at"], time.monotonic()
        return ExcCodes.DEVICE_BUSY if last_s["at"] - before_s < 0.04 else None

    reads = ((1, 3, 0, 10), (2, 3, 0, 10), (2, 3, 20, 8), (2, 3, 30, 8), (1, 3, 20, 4))
    return line_of({"unit1": device(1), "unit2": device(2, Manner(act))}, _plain(*reads))


def dead() -> BusScenario:
    reads = ((1, 3, 0, 10), (3, 3, 0, 10), (2, 3, 0, 10), (1, 4, 0, 20))
    return line_of({"unit1": device(1), "unit2": device(2)}, _plain(*reads))


def absent() -> BusScenario:
    """The bus keeps back what the unit says while its supply is off."""
    turns = itertools.count()

    def disturb(sender: str, written: bytes) -> bytes:
        off = sender == "unit2" and 30 <= next(turns) < 50
        return b"" if off else written

    reads = ((1, 3, 0, 10), (2, 3, 0, 10), (2, 4, 100, 8))
    return line_of({"unit1": device(1), "unit2": device(2)}, _plain(*reads, turns=45), disturb)


def writer() -> BusScenario:
    def script(client: ModbusSerialClient) -> Steps:
        for _ in range(30):
            yield from cycle(client, 1, (1, 3, 0, 10), (2, 3, 0, 10), (2, 4, 100, 8))
            yield partial(client.write_registers, 40, [250, 0, 1], device_id=2)

    return line_of({"unit1": device(1), "unit2": device(2)}, script)


def spikes() -> BusScenario:
    units = {"unit1": device(1), "unit2": device(2, Manner(spikes=17))}
    return line_of(units, _plain((1, 3, 0, 10), (2, 3, 0, 10), (2, 3, 20, 6), turns=60))


def saturated() -> BusScenario:
    reads = ((1, 3, 0, 60), (2, 3, 0, 60), (3, 3, 0, 60), (1, 4, 0, 60), (2, 4, 0, 60))
    scenario = line_of(_three(), _plain(*reads, turns=6))
    return BusScenario(
        scenario.units,
        scenario.script,
        baud=9600,
        trigger=14,
        hears=scenario.hears,
        timeout_s=1.0,
        retries=0,
    )


def slow() -> BusScenario:
    """A unit that works for 100 to 190 ms, and a master that waits 150."""
    works_s = (0.1, 0.12, 0.175, 0.11, 0.13, 0.19, 0.12, 0.105, 0.14)
    units = {"unit1": device(1), "unit2": device(2, Manner(works_s=works_s))}

    return line_of(units, _plain((1, 3, 0, 10), (2, 3, 0, 10), (1, 4, 0, 20), turns=30))


def strays() -> BusScenario:
    """A driver that is switched off lets an unbiased line float."""
    numbers = itertools.count()

    def disturb(sender: str, written: bytes) -> bytes:
        floats = sender == "unit2" and next(numbers) % 3 == 1
        return written + b"\x00" if floats else written

    reads = ((1, 3, 0, 10), (2, 3, 0, 10), (1, 4, 0, 20), (2, 4, 0, 8))
    return line_of({"unit1": device(1), "unit2": device(2)}, _plain(*reads, turns=30), disturb)


def late_driver() -> BusScenario:
    """Where unit 2 answers sooner than 9 ms after the request, its first byte is lost."""
    asked_s = {"at": 0.0}

    def disturb(sender: str, written: bytes) -> bytes:
        now_s = time.monotonic()
        if sender == "master":
            asked_s["at"] = now_s + len(written) * 11 / 57600
        soon = sender == "unit2" and now_s - asked_s["at"] < 0.009
        return written[1:] if soon else written

    works_s = (0.001, 0.02, 0.015, 0.002, 0.03, 0.025, 0.001, 0.018)
    units = {"unit1": device(1), "unit2": device(2, Manner(works_s=works_s))}
    reads = ((1, 3, 0, 10), (2, 3, 0, 10), (2, 4, 0, 8))
    return line_of(units, _plain(*reads, turns=28), disturb)


def too_fast() -> BusScenario:
    """Unit 2 is deaf for 25 ms after other traffic."""
    quiet_s = {"since": 0.0, "before": 0.0}

    def disturb(sender: str, written: bytes) -> bytes:
        now_s = time.monotonic()
        if sender == "master":
            quiet_s["before"] = now_s - quiet_s["since"]
        deaf = sender == "unit2" and quiet_s["before"] < 0.025
        quiet_s["since"] = now_s + len(written) * 11 / 57600
        return b"" if deaf else written

    def script(client: ModbusSerialClient) -> Steps:
        pauses_s = itertools.cycle((0.0, 0.04, 0.0, 0.055, 0.035, 0.0, 0.07))
        for step in cycle(client, 30, (1, 3, 0, 10), (2, 3, 0, 10), (1, 4, 0, 20)):
            yield step
            yield partial(time.sleep, next(pauses_s))

    return line_of({"unit1": device(1), "unit2": device(2)}, script, disturb)


def two_with_one_address() -> BusScenario:
    """Both units 2 answer at once: a low level of either one wins."""
    first: list[bytes] = []

    def disturb(sender: str, written: bytes) -> bytes:
        if sender not in ("unit2", "twin"):
            return written
        if not first:
            first.append(written)
            return b""
        return bytes(one & other for one, other in zip(first.pop(), written, strict=True))

    units = {"unit1": device(1), "unit2": device(2), "twin": device(2, Manner(shift=1000))}
    reads = ((1, 3, 0, 10), (2, 3, 0, 10), (1, 4, 0, 20))
    return line_of(units, _plain(*reads, turns=25), disturb)
