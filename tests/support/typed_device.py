"""A device with registers of every kind that moves as plants move, and the truth about them.

For the recording `pymodbus_types`, from which `modlens learn` has to find types and orders again.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from pymodbus.client import ModbusSerialClient
from pymodbus.constants import ExcCodes
from pymodbus.simulator import DataType, SimAction, SimData, SimDevice

__all__ = ["BLOCK", "SINGLES", "TRUTH", "MultiRegisterValue", "poll_types", "typed_device"]

BLOCK = 66
"""Registers that the master reads at once; the counter at 47 it also reads alone."""

TURNS = 60

CODES = {"f32": ">f", "f64": ">d", "u32": ">I", "s32": ">i", "u64": ">Q"}


@dataclass(frozen=True, slots=True)
class MultiRegisterValue:
    """A value of several registers: its type, its order, its value in turn n."""

    kind: str
    order: str
    value: Callable[[int], float | str]


def _wave(mean: float, swing: float, period: float) -> Callable[[int], float]:
    noise = random.Random(f"{mean} {swing}")
    steps = [noise.gauss(0, swing / 20) for _ in range(4 * TURNS)]
    return lambda turn: mean + swing * math.sin(turn / period) + steps[turn % len(steps)]


def _tenths(wave: Callable[[int], float], digits: int) -> Callable[[int], float]:
    return lambda turn: round(wave(turn), digits)


def _whole(wave: Callable[[int], float]) -> Callable[[int], int]:
    return lambda turn: round(wave(turn))


def _count(start: int, step: int) -> Callable[[int], int]:
    return lambda turn: start + step * turn + turn % 7


TRUTH = {
    2: MultiRegisterValue("f32", "ABCD", _tenths(_wave(230, 3, 9), 2)),
    4: MultiRegisterValue("f32", "ABCD", _wave(50, 0.05, 5)),
    6: MultiRegisterValue("f32", "CDAB", _wave(1500, 300, 12)),
    8: MultiRegisterValue("f32", "CDAB", _wave(0.93, 0.05, 7)),
    10: MultiRegisterValue("u32", "ABCD", _count(1_234_567, 1_931)),
    12: MultiRegisterValue("u32", "CDAB", _count(77_000_123, 7_321)),
    14: MultiRegisterValue("s32", "ABCD", _whole(_wave(0, 90_000, 6))),
    16: MultiRegisterValue("s32", "CDAB", _whole(_wave(5_000, 70_000, 8))),
    18: MultiRegisterValue("f64", "ABCD", _wave(8_123.5, 40, 10)),
    22: MultiRegisterValue("u64", "ABCD", _count(1_700_000_000_000_000_000, 100_003_217)),
    26: MultiRegisterValue("str", "ABCD", lambda _: "modlens typed device"),
    37: MultiRegisterValue("f32", "ABCD", lambda _: 0.1),
    39: MultiRegisterValue("u32", "ABCD", lambda _: 100_000),
    41: MultiRegisterValue("f32", "BADC", _wave(21, 4, 11)),
    43: MultiRegisterValue("f32", "DCBA", _tenths(_wave(-12, 6, 8), 1)),
    45: MultiRegisterValue("f32", "CDAB", _tenths(_wave(4.2, 0.4, 9), 3)),
    47: MultiRegisterValue("u32", "ABCD", _count(1_180_000, 1)),
    49: MultiRegisterValue("f32", "CDAB", _wave(98_000, 2_000, 13)),
    51: MultiRegisterValue("f32", "ABCD", _tenths(_wave(7.1, 0.2, 6), 2)),
    53: MultiRegisterValue("u32", "CDAB", _count(400_000, 911)),
    55: MultiRegisterValue("f32", "ABCD", _wave(-3.3, 9.0, 7)),
}
"""Address -> value of several registers."""

SINGLES: dict[int, Callable[[int], int]] = {
    0: _whole(_wave(215, 12, 9)),
    1: lambda turn: (0, 0, 1, 3)[turn // 9 % 4],
    36: lambda _: 4711,
    57: _whole(_wave(0, 40, 8)),
    58: lambda turn: (17 * turn + 100) % 0x10000,
    59: _whole(_wave(17_000, 900, 9)),
    60: _whole(_wave(1_000, 300, 5)),
    61: lambda _: 0,
    62: lambda turn: 0x8001 if turn % 5 else 0x8003,
    63: _whole(_wave(30_000, 5_000, 14)),
    64: lambda _: 9_600,
    65: lambda turn: turn // 4,
}
"""Address -> value of one register."""


def registers(turn: int) -> list[int]:
    """All registers in turn n."""
    found = [0] * BLOCK
    for address, single in SINGLES.items():
        found[address] = single(turn) & 0xFFFF
    for address, wide in TRUTH.items():
        value = wide.value(turn)
        if isinstance(value, str):
            data = value.encode()
        else:
            data = struct.pack(CODES[wide.kind], value)
        words = [data[i : i + 2] for i in range(0, len(data), 2)]
        if wide.order in ("CDAB", "DCBA"):
            words.reverse()
        if wide.order in ("BADC", "DCBA"):
            words = [word[::-1] for word in words]
        for offset, word in enumerate(words):
            found[address + offset] = int.from_bytes(word, "big")
    return found


def typed_device(unit: int) -> SimDevice:
    """A device whose registers move on with every read of the whole block."""
    return SimDevice(
        unit,
        simdata=[SimData(0, values=registers(0), datatype=DataType.REGISTERS)],
        action=_moving(),
    )


def _moving() -> SimAction:
    turn = 0

    async def act(
        _function: int,
        _start: int,
        _address: int,
        count: int,
        values: list[int],
        written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        nonlocal turn
        if written is None and count == BLOCK:
            turn += 1
            values[:BLOCK] = registers(turn)
        return None

    return act


def poll_types(client: ModbusSerialClient, unit: int = 5) -> Iterator[Callable[[], object]]:
    """Read the block again and again, and the slow counter by itself more often."""
    for turn in range(TURNS):
        yield partial(client.read_holding_registers, 0, count=BLOCK, device_id=unit)
        if turn < TURNS // 3:
            for _ in range(4):
                yield partial(client.read_holding_registers, 47, count=2, device_id=unit)
