"""A live tap in a program: without settings, with `async for`, and asked from other threads."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
import time
from collections.abc import Iterator

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

import modlens

REQUEST = bytes.fromhex("010300000001840a")
RESPONSE = bytes.fromhex("0103020007f986")
PAUSE_S = 0.02


class Line:
    """A pty on which a master asks a unit again and again, until it is asked to stop."""

    def __init__(self) -> None:
        self.far, self._near = os.openpty()
        self.name = os.ttyname(self._near)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._poll)

    def start(self) -> None:
        """Begin to poll."""
        self._thread.start()

    def stop(self) -> None:
        """End the polling and close the pty."""
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join()
        for descriptor in (self.far, self._near):
            os.close(descriptor)

    def _poll(self) -> None:
        while not self._ended.wait(PAUSE_S):
            os.write(self.far, REQUEST)
            time.sleep(PAUSE_S)
            os.write(self.far, RESPONSE)


@pytest.fixture
def line() -> Iterator[Line]:
    """A line whose polling has not begun."""
    made = Line()
    yield made
    made.stop()


def test_transactions_come_to_async_for(line: Line) -> None:
    """Other tasks run while a tap waits."""
    ticks = 0

    async def tick() -> None:
        nonlocal ticks
        while True:
            ticks += 1
            await asyncio.sleep(0.01)

    async def listen() -> list[str]:
        ticking = asyncio.create_task(tick())
        found = []
        with modlens.tap(line.name, line="19200-8E1") as bus:
            line.start()
            async for transaction in bus:
                found.append(transaction.status)
                if len(found) == 3:
                    break
        ticking.cancel()
        return found

    assert asyncio.run(listen()) == ["ok", "ok", "ok"]
    assert ticks > 3


def test_settings_are_found_by_listening(line: Line) -> None:
    """A tap without line settings searches them, and says what it found."""
    said: list[str] = []
    with modlens.tap(line.name, notify=said.append) as bus:
        line.start()
        assert next(iter(bus)).status == "ok"
    assert any("found" in text for text in said), said


def test_statistics_are_given_to_other_threads(line: Line) -> None:
    """Asked two hundred times while the tap decodes: an answer each time, and soon."""
    waits = []
    with modlens.tap(line.name, line="19200-8E1") as bus:
        line.start()
        reader = threading.Thread(target=lambda: [None for _ in bus])
        reader.start()
        for _ in range(200):
            begun = time.monotonic()
            assert bus.stats()["buses"]
            waits.append(time.monotonic() - begun)
        bus.close()
        reader.join(timeout=5)
        assert not reader.is_alive()
    assert sorted(waits)[100] < 1.0


def test_close_from_another_thread_ends_the_iteration(line: Line) -> None:
    """Nothing is raised where the transactions are waited for."""
    bus = modlens.tap(line.name, line="19200-8E1")
    closer = threading.Timer(0.3, bus.close)
    closer.start()
    assert list(bus) == []
    closer.join()
    assert bus.stats()["buses"]
