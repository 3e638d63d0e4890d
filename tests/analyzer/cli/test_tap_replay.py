"""`tap --record`, then `decode --replay`: the very rows of the tap, to the last column.

pymodbus polls over a paced pty bus, frames are disturbed, bytes lost, answers missing; the tap
writes its rows and its raw recording at once.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

pytest.importorskip("pymodbus")
if sys.platform != "linux":
    pytest.skip("the bus is made of Linux' ptys", allow_module_level=True)

from pymodbus import FramerType, ModbusException
from pymodbus.client import ModbusSerialClient

from analyzer.cli import main
from tests.conftest import ROOT, command, environment
from tests.support import master_scripts
from tests.support.devices import demo_device
from tests.support.ptybus import PtyBus, flip_bit
from tests.support.pymodbus_buses import BusScenario, Servers

TABLES = ("frames", "transactions", "findings", "readings")


@contextlib.contextmanager
def tapped(folder: Path, ports: Sequence[str], *words: str) -> Iterator[None]:
    """A tap that records and writes all tables; ended by Ctrl-C."""
    outputs = [f"{table}:{folder}/live.{table}.csv" for table in TABLES]
    more = [word for output in outputs for word in ("-o", output)]
    running = subprocess.Popen(
        command("tap", *ports, "--record", folder / "bus.pcapng", *more, *words),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment(), cwd=ROOT,
    )  # fmt: skip
    assert running.stderr is not None
    while b"recording to" not in (line := running.stderr.readline()):
        assert line
    try:
        yield
    finally:
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=60)
    assert running.returncode == 0


def replayed(folder: Path, *words: str) -> None:
    """The tables of the replay are byte for byte those of the tap."""
    names = sorted(str(one) for one in folder.glob("bus*.pcapng"))
    outputs = [word for table in TABLES for word in ("-o", f"{table}:{folder}/replay.{table}.csv")]
    assert main(["decode", *names, "--replay", *words, *outputs]) == 0
    for table in TABLES:
        live = (folder / f"live.{table}.csv").read_text()
        assert (folder / f"replay.{table}.csv").read_text() == live, table
        assert live.count("\n") > 5, table


def disturbance(seed: int) -> Callable[[str, bytes], bytes]:
    """Disturbs the unit's responses: flipped bits, lost bytes, lost responses."""
    rng = random.Random(seed)

    def disturb(sender: str, written: bytes) -> bytes:
        # What a server of pymodbus makes of damaged requests is not what this is about.
        match rng.randrange(12) if sender == "unit" else None:
            case 0:
                return flip_bit(written, rng.randrange(8 * len(written)))
            case 1:
                return written[: rng.randrange(len(written))]
            case 2:
                return b""
            case 3:
                return written[1:]
        return written

    return disturb


def polls(bus: PtyBus, client: ModbusSerialClient, rounds: int) -> None:
    """The client's polls with noise between them, and a last request without response."""
    with contextlib.closing(client):
        client.connect()
        for number in range(rounds):
            if number % 3 == 1:
                bus.inject(b"\x00\xff\xf0"[: number % 4])
            for step in master_scripts.plain_polls(client, 17):
                with contextlib.suppress(ModbusException):
                    step()
                time.sleep(0.004)
        with contextlib.suppress(ModbusException):
            client.read_holding_registers(0, device_id=99)
    bus.wait_idle()


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_a_replay_gives_the_rows_of_the_tap(mode: str, tmp_path: Path) -> None:
    """A replayed recording gives the tap's rows, for RTU and ASCII, valid and damaged frames."""
    framer = FramerType.RTU if mode == "rtu" else FramerType.ASCII
    scenario = BusScenario(
        {"unit": demo_device(17)}, master_scripts.plain_polls, framer=framer, disturb=disturbance(3)
    )
    names = ["master", "unit", "tap"]
    with (
        PtyBus(names, 19200, turnaround_chars=3.5, disturb=scenario.disturb, trigger=5) as bus,
        Servers(scenario, bus, {"unit": []}),
        tapped(tmp_path, [bus.path("tap")], "--line", "19200-8E1"),
    ):
        client = ModbusSerialClient(
            bus.path("master"), framer=framer, baudrate=19200, timeout=0.08, retries=1
        )
        polls(bus, client, 2)
        time.sleep(0.1)
    replayed(tmp_path)


def test_two_buses_in_segments_are_one_replay(tmp_path: Path) -> None:
    """One of a single port, one of two lines; numbers run across both, and across files."""
    pairs = [os.openpty() for _ in range(3)]
    ports = [os.ttyname(near) for _, near in pairs]
    names = [f"one={ports[0]}@9600-8N1", f"two={ports[1]}+{ports[2]}@19200-8E1"]
    request, response = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
    rng = random.Random(5)
    with tapped(tmp_path, names, "--rotate", "2kB"):
        for _ in range(32):
            other = rng.random() < 0.5
            asks, answers = (pairs[1][0], pairs[2][0]) if other else (pairs[0][0], pairs[0][0])
            cut = rng.randrange(len(request) + 1)
            os.write(asks, request[:cut])
            time.sleep(rng.choice([0.001, 0.002, 0.15]))
            os.write(asks, request[cut:])
            if rng.random() < 0.8:
                time.sleep(0.01)
                os.write(answers, response[: rng.choice([7, 7, 7, 3])])
            time.sleep(rng.choice([0.005, 0.02, 0.12]))
    assert len(list(tmp_path.glob("bus_0*.pcapng"))) > 2
    replayed(tmp_path)
    for far, near in pairs:
        os.close(far)
        os.close(near)
