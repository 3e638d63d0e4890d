"""One line, tapped directly and through another program: the rows of both, side by side.

    with PtyBus([MASTER, UNIT, "tap", "proxy"], 9600, 10) as bus:
        with Heard(bus.path("tap")) as direct, Heard("socket://127.0.0.1:4001") as other:
            poll(bus, seconds=5)
        assert differences(direct.rows, other.rows) == Differences()

Each exchange has an address of its own, so that rows can be distinguished.
"""

from __future__ import annotations

import os
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Self

from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from tests.support.gateway_model import crc
from tests.support.ptybus import PtyBus

__all__ = [
    "MASTER",
    "UNIT",
    "WHOLE",
    "Differences",
    "Heard",
    "Row",
    "differences",
    "exchanges",
    "poll",
    "row_of",
]

MASTER, UNIT = "master", "unit"
WHOLE = 14
"""The FIFO of receivers, which holds a whole frame: a busy machine pauses between two reads."""
SETTLE_S = 30.0

Row = tuple[Any, ...]
"""What does not depend on the way: unit, function, request, values, status."""


class Heard:
    """A tap in a thread; `rows` are its transactions, `said` its messages."""

    def __init__(self, name: str) -> None:
        self.rows: list[Row] = []
        self.said: list[str] = []
        self._run = LiveRun([name], Settings(), notify=self.said.append)
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._is_over.set()
        self._thread.join()
        self._run.close()

    def wait_for(self, count: int) -> None:
        """Wait for rows."""
        end = time.monotonic() + SETTLE_S
        while len(self.rows) < count:
            assert time.monotonic() < end, (len(self.rows), count, self.said)
            time.sleep(0.05)

    def returned(self) -> int:
        """How often it was connected again."""
        return sum("back after" in text for text in self.said)

    def _listen(self) -> None:
        for batch in self._run.batches():
            self._keep(batch)
            if self._is_over.is_set():
                break
        self._keep(self._run.finish())

    def _keep(self, batch: Any) -> None:
        self.rows += map(row_of, batch.transactions)


def row_of(transaction: Any) -> Row:
    """A transaction as it is compared."""
    one = transaction
    return one.unit, one.function, one.request_hex, tuple(one.data or ()), one.status


def exchanges() -> Iterator[tuple[bytes, bytes | None]]:
    """Requests with responses, None for silence: reads, writes, exceptions, a unit that is off."""
    for number in range(65_000):
        unit, kind = number % 5 + 1, number % 16
        value = struct.pack(">H", number * 7919 % 65_536)
        place = struct.pack(">H", number)
        if kind == 3:
            yield _frame(unit, 6, place + value), _frame(unit, 6, place + value)
        elif kind == 7:
            yield _frame(unit, 16, place + b"\0\1\2" + value), _frame(unit, 16, place + b"\0\1")
        elif kind == 11:
            yield _frame(unit, 3, place + b"\0\1"), _frame(unit, 0x83, b"\2")
        elif kind == 13:
            yield _frame(9, 3, place + b"\0\1"), None
        else:
            count = kind % 4 + 1
            data = b"".join(struct.pack(">H", (number + one) % 65_536) for one in range(count))
            yield (
                _frame(unit, 4, place + bytes([0, count])),
                _frame(unit, 4, bytes([2 * count]) + data),
            )


def poll(bus: PtyBus, *, seconds: float, between: Callable[[float], None] = lambda _: None) -> int:
    """Play exchanges for so long, the last one answered; gives their number.

    `between` is called before each.
    """
    ports = {name: os.open(bus.path(name), os.O_RDWR | os.O_NOCTTY) for name in (MASTER, UNIT)}
    begun = time.monotonic()
    count = carried = 0
    for request, response in exchanges():
        count += 1
        between(time.monotonic() - begun)
        os.write(ports[MASTER], request)
        carried += len(request)
        bus.wait_idle(carried)
        if response is None:
            time.sleep(0.2)
        else:
            time.sleep(0.005)
            os.write(ports[UNIT], response)
            carried += len(response)
            bus.wait_idle(carried)
        time.sleep(0.03)
        if response is not None and time.monotonic() - begun > seconds:
            break
    for port in ports.values():
        os.close(port)
    return count


@dataclass(frozen=True, slots=True)
class Differences:
    """Rows that only one tap has, and runs of rows of the first one that the second one lacks."""

    missing: list[Row] = field(default_factory=list)
    extra: list[Row] = field(default_factory=list)
    holes: int = 0
    is_in_order: bool = True


def differences(direct: list[Row], other: list[Row]) -> Differences:
    """What distinguishes the rows of two taps of one line."""
    common = set(direct) & set(other)
    holes = sum(
        row not in common and (at == 0 or direct[at - 1] in common) for at, row in enumerate(direct)
    )
    return Differences(
        [row for row in direct if row not in common],
        [row for row in other if row not in common],
        holes,
        [row for row in direct if row in common] == [row for row in other if row in common],
    )


def _frame(unit: int, function: int, rest: bytes) -> bytes:
    body = bytes([unit, function]) + rest
    return body + crc(body)
