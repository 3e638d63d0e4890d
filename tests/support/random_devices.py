"""Randomly generated devices: registers of every kind, in blocks and orders that a seed decides.

For `modlens learn`: what it learns has to be right on devices that its author had never seen.
Nothing here was changed to suit it.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from pymodbus.client import ModbusSerialClient
from pymodbus.constants import ExcCodes
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
)
from pymodbus.simulator import DataType, SimAction, SimData, SimDevice

__all__ = ["Item", "RandomDevice"]

CODES = {"f32": ">f", "f64": ">d", "u32": ">I", "s32": ">i", "u64": ">Q", "s64": ">q"}
WIDTHS = {"f32": 2, "f64": 4, "u32": 2, "s32": 2, "u64": 4, "s64": 4}

MIX = {
    "wave": 7, "tenths": 6, "total": 4, "slow total": 2, "energy": 2, "balance": 3, "debt": 2,
    "f64": 1, "s64": 1, "text": 2, "parameter": 1,
    "word": 6, "signed": 3, "enum": 4, "constant": 3, "ticks": 2, "flags": 2,
}  # fmt: skip
"""Kind of value -> how many a device has; all but the last two lines take several registers."""


@dataclass(frozen=True, slots=True)
class Item:
    """A value of a device: type, order, and a function from the poll number to the value."""

    kind: str
    order: str
    value: Callable[[int], float | str]

    @property
    def wide(self) -> bool:
        """Whether it takes several registers."""
        return self.kind not in ("u16", "s16")

    def words(self, turn: int) -> list[int]:
        """The registers of the value in poll `turn`."""
        value = self.value(turn)
        if isinstance(value, str):
            data = value.encode().ljust(2 * self.width(value), b"\0")
        elif self.wide:
            data = struct.pack(CODES[self.kind], value)
        else:
            data = (int(value) & 0xFFFF).to_bytes(2, "big")
        words = [data[at : at + 2] for at in range(0, len(data), 2)]
        if self.order in ("CDAB", "DCBA"):
            words.reverse()
        if self.order in ("BADC", "DCBA"):
            words = [word[::-1] for word in words]
        return [int.from_bytes(word, "big") for word in words]

    def width(self, text: str) -> int:
        """Registers of a text: even a short one has some room."""
        return (len(text) + 2) // 2


class RandomDevice:
    """The device of a seed.

    Its values by address, the blocks in which it is polled, and what it answers.
    """

    def __init__(self, seed: int) -> None:
        """Throw the dice."""
        self._rng = rng = random.Random(seed)
        self.turns = rng.randrange(60, 160)
        usual, other = rng.choice([("ABCD", "CDAB"), ("CDAB", "ABCD")])
        kinds = [kind for kind, count in MIX.items() for _ in range(count)]
        rng.shuffle(kinds)
        self.items: dict[int, Item] = {}
        self.blocks: list[tuple[int, int]] = []
        first = address = rng.randrange(0, 4000)
        for kind in kinds:
            order = "ABCD" if kind == "text" else usual if rng.random() < 0.8 else other
            item = self._make(kind, order)
            width = len(item.words(0))
            if address + width - first > rng.randrange(20, 110):
                self.blocks.append((first, address - first))
                first = address = address + rng.randrange(1, 300)
            self.items[address] = item
            address += width
        self.blocks.append((first, address - first))

    def registers(self, turn: int) -> dict[int, int]:
        """All registers in turn n."""
        return {
            address + offset: word
            for address, item in self.items.items()
            for offset, word in enumerate(item.words(turn))
        }

    def decidable(self, address: int) -> bool:
        """Whether the recording shows that the value's registers are one.

        Where the upper half never moves, every bit that was recorded is also that of a constant
        beside a smaller number.
        """
        item = self.items[address]
        if item.kind == "str":
            return True
        half = len(item.words(0)) // 2
        high = slice(0, half) if item.order in ("ABCD", "BADC") else slice(half, None)
        return len({tuple(item.words(turn)[high]) for turn in range(self.turns)}) > 1

    def _make(self, kind: str, order: str) -> Item:
        makers: dict[str, Callable[[], tuple[str, Callable[[int], float | str]]]] = {
            "wave": lambda: ("f32", self._wave()),
            "tenths": lambda: ("f32", self._rounded(self._wave(), self._rng.randrange(1, 4))),
            "total": lambda: ("u32", self._counter(10 ** self._rng.uniform(6.5, 9.5), 10, 4000)),
            "slow total": lambda: ("u32", self._counter(10 ** self._rng.uniform(5.5, 9), 1, 9)),
            "energy": lambda: ("u64", self._counter(10 ** self._rng.uniform(11, 17), 50, 10**6)),
            "balance": lambda: ("s32", self._whole(self._around(0, 10 ** self._rng.uniform(4, 8)))),
            "debt": lambda: ("s32", self._whole(self._wave(sign=-1, low=5.3, high=8))),
            "f64": lambda: ("f64", self._wave()),
            "s64": lambda: ("s64", self._whole(self._around(0, 10 ** self._rng.uniform(10, 14)))),
            "text": lambda: ("str", self._text()),
            "parameter": self._parameter,
            "word": lambda: ("u16", self._whole(self._wave(low=1.5, high=4.3))),
            "signed": lambda: ("s16", self._whole(self._around(0, self._rng.uniform(20, 9000)))),
            "enum": lambda: ("u16", self._states()),
            "constant": lambda: ("u16", self._fixed(self._rng.randrange(65536))),
            "ticks": lambda: ("u16", self._ticks()),
            "flags": lambda: ("u16", self._states(bits=True)),
        }
        found, value = makers[kind]()
        return Item(found, order, value)

    def _wave(
        self, *, sign: int = 1, low: float = -0.5, high: float = 5.0
    ) -> Callable[[int], float]:
        mean = sign * 10 ** self._rng.uniform(low, high)
        return self._around(mean, abs(mean) * 10 ** self._rng.uniform(-2.3, -0.4))

    def _around(self, mean: float, swing: float) -> Callable[[int], float]:
        period, phase = self._rng.uniform(4, 40), self._rng.uniform(0, 6)
        noise = [self._rng.gauss(0, swing / self._rng.choice([8, 30, 200])) for _ in range(200)]
        return lambda turn: mean + swing * math.sin(turn / period + phase) + noise[turn % 200]

    def _rounded(self, wave: Callable[[int], float], digits: int) -> Callable[[int], float]:
        return lambda turn: round(wave(turn), digits)

    def _whole(self, wave: Callable[[int], float]) -> Callable[[int], int]:
        return lambda turn: round(wave(turn))

    def _counter(self, start: float, low: int, high: int) -> Callable[[int], int]:
        step = self._rng.randrange(low, high)
        jitter = [self._rng.randrange(step + 1) for _ in range(400)]
        totals = [round(start)]
        for more in jitter:
            totals.append(totals[-1] + step // 2 + more)
        return lambda turn: totals[turn]

    def _text(self) -> Callable[[int], str]:
        words = ["Pumpe", "meter", "AX", "rev", "Boiler", "v2", "2024", "-", "SN", "north"]
        text = " ".join(self._rng.sample(words, 3))
        return lambda _: text

    def _parameter(self) -> tuple[str, Callable[[int], float]]:
        kind = self._rng.choice(["f32", "u32"])
        value = self._rng.choice([0.5, 100.0, 12.25]) if kind == "f32" else 86_400
        return kind, lambda _: value

    def _fixed(self, value: int) -> Callable[[int], int]:
        return lambda _: value

    def _states(self, *, bits: bool = False) -> Callable[[int], int]:
        states = self._rng.sample(range(9), 4)
        values = [1 << state for state in states] if bits else states
        stay = self._rng.randrange(3, 30)
        return lambda turn: values[turn // stay % 4]

    def _ticks(self) -> Callable[[int], int]:
        start, step = self._rng.randrange(65536), self._rng.choice([1, 3, 60, 997])
        return lambda turn: start + step * turn

    def recording(self, unit: int = 9) -> str:
        """The polls as pymodbus frames them, a frame a line."""
        framer = FramerRTU(DecodePDU(is_server=False))
        lines = []
        for turn in range(self.turns):
            values = self.registers(turn)
            for first, count in self.blocks:
                part = [values.get(first + offset, 0) for offset in range(count)]
                for pdu in (
                    ReadHoldingRegistersRequest(address=first, count=count, dev_id=unit),
                    ReadHoldingRegistersResponse(registers=part, dev_id=unit),
                ):
                    lines.append(_framed(framer, pdu).hex(" "))
        return "\n".join(lines) + "\n"

    def device(self, unit: int) -> SimDevice:
        """A server's device; its registers move on with every read of the first block."""
        places = self.registers(0)
        low, high = min(places), max(places)
        values = [places.get(address, 0) for address in range(low, high + 1)]
        data = SimData(low, values=values, datatype=DataType.REGISTERS)
        return SimDevice(unit, simdata=[data], action=self._moving(low))

    def _moving(self, low: int) -> SimAction:
        turn = -1

        async def act(
            _function: int, _start: int, address: int, _count: int, values: list[int],
            written: list[int] | list[bool] | None,
        ) -> ExcCodes | None:  # fmt: skip
            nonlocal turn
            if written is None and address == self.blocks[0][0]:
                turn += 1
                for place, word in self.registers(turn).items():
                    values[place - low] = word
            return None

        return act

    def poll(self, client: ModbusSerialClient, unit: int) -> Iterator[Callable[[], object]]:
        """All blocks in turn, again and again."""
        for _ in range(self.turns):
            for first, count in self.blocks:
                yield partial(client.read_holding_registers, first, count=count, device_id=unit)


def _framed(framer: Any, pdu: ModbusPDU) -> bytes:
    framed: bytes = framer.buildFrame(pdu)
    return framed
