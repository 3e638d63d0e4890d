"""Lets pymodbus' own client and servers talk over a `PtyBus` while a tap listens.

    outcome = play(Play(units={"unit1": demo_device}, script=plain_polls), Path("bus.jsonl"))

Nothing of modlens is in here. Ptys have no parity, so the ports are opened without; the bus paces
by `char_bits`. Each server hears all requests and gets to see those to its own unit or to all: of
its own accord pymodbus (3.16) answers some functions for any unit.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import Callable, Collection, Coroutine, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self, cast

from pymodbus import FramerType, ModbusException
from pymodbus.client import ModbusSerialClient
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import SimDevice

from tests.support.devices import UnknownFunctionRequest, identity, prime_counters
from tests.support.ptybus import ChunkLogRecorder, PtyBus, Sent

MASTER, TAP = "master", "tap"
SILENCE_S = 0.005
"""Between transactions: more than 3.5 characters at 19200 baud, which are 2.0 ms."""
START_TIMEOUT_S = 10.0


@dataclass(frozen=True, slots=True)
class BusScenario:
    """Who is on the bus and what happens there.

    `units` maps participants to their devices; `script` yields the master's steps; `noise` is put
    on the idle line before the step of that number. `timeout_s` and `retries` are the client's; the
    others are the settings of `PtyBus`.
    """

    units: Mapping[str, SimDevice]
    script: Callable[[ModbusSerialClient], Iterator[Callable[[], object]]]
    framer: FramerType = FramerType.RTU
    baud: int = 19200
    char_bits: int = 11
    trigger: int = 1
    turnaround_chars: float = 3.5
    hears: Mapping[str, Collection[str]] = field(default_factory=dict)
    disturb: Callable[[str, bytes], bytes] | None = None
    timeout_s: float = 0.3
    retries: int = 2
    noise: Mapping[int, bytes] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ScenarioResult:
    """What came of it: the line's truth, each participant's own account, and the tap's bytes.

    `traced` maps a participant to what its pymodbus handed to its port, one item per frame.
    """

    truth: tuple[Sent, ...]
    traced: Mapping[str, list[bytes]]
    heard: bytes


def run_scenario(scenario: BusScenario, log_path: Path) -> ScenarioResult:
    """Run the script to its end and record the tap's chunk log at `log_path`.

    Raises TimeoutError when the bus does not come to rest, BusError when it broke down.
    """
    prime_counters()
    traced: dict[str, list[bytes]] = {name: [] for name in (MASTER, *scenario.units)}
    bus = PtyBus(
        [MASTER, *scenario.units, TAP],
        scenario.baud,
        scenario.char_bits,
        trigger=scenario.trigger,
        turnaround_chars=scenario.turnaround_chars,
        hears=scenario.hears,
        disturb=scenario.disturb,
    )
    with bus, ChunkLogRecorder(bus.path(TAP), log_path) as recorder, Servers(scenario, bus, traced):
        client = ModbusSerialClient(
            bus.path(MASTER),
            framer=scenario.framer,
            baudrate=scenario.baud,
            timeout=scenario.timeout_s,
            retries=scenario.retries,
            trace_packet=_tracer(traced[MASTER]),
        )
        with contextlib.closing(client):
            _follow(scenario, client, bus)
        bus.wait_idle()
        recorder.wait_for(sum(len(sent.data) for sent in bus.truth))
    return ScenarioResult(bus.truth, traced, recorder.data)


def _follow(scenario: BusScenario, client: ModbusSerialClient, bus: PtyBus) -> None:
    """Take the script's steps; what pymodbus raises is part of the recording."""
    client.connect()  # before any noise: a pty keeps what nobody reads
    for number, step in enumerate(scenario.script(client)):
        if number in scenario.noise:
            bus.inject(scenario.noise[number])
            time.sleep(SILENCE_S)
        with contextlib.suppress(ModbusException):
            step()
        time.sleep(SILENCE_S)


class Servers:
    """pymodbus' serial servers, one for each unit, in a loop of their own; used by `with`."""

    def __init__(
        self, scenario: BusScenario, bus: PtyBus, traced: Mapping[str, list[bytes]]
    ) -> None:
        """Name the units and the bus; nothing is opened yet."""
        self._what = scenario
        self._bus = bus
        self._traced = traced
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="units", daemon=True)
        self._servers: list[ModbusSerialServer] = []

    def __enter__(self) -> Self:
        """Open all ports; RuntimeError when pymodbus cannot."""
        self._thread.start()
        for name, device in self._what.units.items():
            start = self._start(name, device)
            asyncio.run_coroutine_threadsafe(start, self._loop).result(START_TIMEOUT_S)
        return self

    def __exit__(self, *error: object) -> None:
        """Close the ports and end the loop."""
        for server in self._servers:
            stop: Callable[[], Coroutine[None, None, None]] = server.shutdown
            asyncio.run_coroutine_threadsafe(stop(), self._loop).result(START_TIMEOUT_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _start(self, name: str, device: SimDevice) -> None:
        server = ModbusSerialServer(
            device,
            framer=self._what.framer,
            identity=identity(),
            port=self._bus.path(name),
            baudrate=self._what.baud,
            broadcast_enable=True,
            trace_packet=_tracer(self._traced[name]),
            trace_pdu=_only_for(device.id),
            custom_pdu=[UnknownFunctionRequest],
        )
        await server.serve_forever(background=True)
        self._servers.append(server)


def _tracer(sent: list[bytes]) -> Callable[[bool, bytes], bytes]:
    """Return a pymodbus hook that notes what is sent and changes nothing."""

    def trace(sending: bool, data: bytes) -> bytes:
        if sending:
            sent.append(data)
        return data

    return trace


def _only_for(unit: int) -> Callable[[bool, ModbusPDU], ModbusPDU]:
    """Return a pymodbus hook that hides requests to other units from a server."""

    def trace(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        foreign = not sending and pdu.dev_id not in (0, unit)
        return cast(ModbusPDU, None) if foreign else pdu

    return trace
