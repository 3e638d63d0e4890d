"""Records captures/pymodbus_two_masters: two pymodbus clients on one line, each with its own cycle.

    python -m tests.support.recording_two_masters

Where they meet, the line carries the AND of both. The frames are what the line carried: where one
participant sent alone, the frame that it wrote; where two did, noise, but for a frame that came
through whole.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import threading
import time
from collections.abc import Sequence, Set
from pathlib import Path

from pymodbus import ModbusException
from pymodbus.client import ModbusSerialClient

from tests.support.colliding_line import CollidingLine
from tests.support.expected import Frame
from tests.support.ptybus import ChunkLogRecorder, PtyBus, Sent
from tests.support.pymodbus_buses import BusScenario, Servers
from tests.support.recording import CAPTURES, frame_lines, toml_text
from tests.support.trouble_scenarios import device

NAME, BAUD, LINE = "pymodbus_two_masters", 19_200, "19200-8E1"
MASTERS = {"master": (0.5, 0.1, 10), "panel": (0.37, 0.15, 4)}
"""The period of each one's cycle, its timeout, and the quantity that it reads."""
LASTS_S, HEAD_START_S = 30.0, 0.09
SHOWS = (
    "Two masters on one line, with cycles of 0.5 s and 0.37 s. Where they meet, both send at once "
    "and the line carries the AND of their bits; requests also fall between the other one's "
    "request and its answer."
)


def record(into: Path) -> None:
    """Record it again."""
    folder = into / NAME
    folder.mkdir(parents=True, exist_ok=True)
    units = {f"unit{unit}": device(unit) for unit in (1, 2)}
    hears = {name: [*MASTERS] for name in units}
    names = [*MASTERS, *units, "tap"]
    bus = PtyBus(names, BAUD, trigger=14, turnaround_chars=0, hears=hears, line=CollidingLine)
    scenario = BusScenario(units, lambda _client: iter(()), baud=BAUD)
    traced: dict[str, list[bytes]] = {name: [] for name in units}
    log = folder / "recording.jsonl"
    with bus, ChunkLogRecorder(bus.path("tap"), log) as recorder, Servers(scenario, bus, traced):
        until_s = time.monotonic() + LASTS_S
        threads = [
            threading.Thread(target=_poll, args=(bus.path(name), until_s, *MASTERS[name]))
            for name in MASTERS
        ]
        for thread in threads:
            thread.start()
            time.sleep(HEAD_START_S)
        for thread in threads:
            thread.join()
        bus.wait_idle()
        recorder.wait_for(sum(len(sent.data) for sent in bus.truth))
        frames = frames_of(bus.truth, {frame for said in traced.values() for frame in said})
    (folder / "frames.jsonl").write_text(frame_lines(frames), encoding="ascii")
    (folder / "about.toml").write_text(_about(), encoding="utf-8")


def _poll(path: str, until_s: float, period_s: float, timeout_s: float, quantity: int) -> None:
    client = ModbusSerialClient(path, baudrate=BAUD, timeout=timeout_s, retries=0)
    client.connect()
    with contextlib.closing(client):
        while (now_s := time.monotonic()) < until_s:
            for unit in (1, 2):
                for read in (client.read_holding_registers, client.read_input_registers):
                    with contextlib.suppress(ModbusException):
                        read(0, count=quantity, device_id=unit)
                    time.sleep(0.006)
            time.sleep(max(0.0, now_s + period_s - time.monotonic()))


def frames_of(truth: Sequence[Sent], answers: Set[bytes]) -> list[Frame]:
    """What one participant sent alone is a frame; of two it is one where its bits prevailed."""
    requests = {sent.written for sent in truth if sent.sender in MASTERS}
    frames: list[Frame] = []
    for sent in truth:
        if "+" not in sent.sender:
            direction = "request" if sent.sender in MASTERS else "response"
            frames.append(_frame(sent.data, direction))
            continue
        whole = next((one for one in {*requests, *answers} if sent.data.endswith(one)), b"")
        noise = sent.data.removesuffix(whole)
        if noise:
            frames.append({"verdict": "noise", "hex": noise.hex()})
        if whole:
            frames.append(_frame(whole, "request" if whole in requests else "response"))
    return frames


def _frame(data: bytes, direction: str) -> Frame:
    unit, function = data[:2]
    return {
        "direction": direction,
        "unit": unit,
        "function": function,
        "verdict": "ok",
        "hex": data.hex(),
    }


def _about() -> str:
    return toml_text(
        {
            "name": NAME,
            "file": "recording.jsonl",
            "format": "chunks",
            "origin": "recorded for modlens: python -m tests.support.recording_two_masters",
            "licence": "MIT, as modlens",
            "line": LINE,
            "mode": "rtu",
            "shows": SHOWS,
            "healthy": False,
            "recorded_with": "pymodbus, pyserial, tests/support/ptybus.py with "
            "tests/support/colliding_line.py on Linux ptys (a pty carries no parity bit)",
            "expected_source": "what the line carried: frames of one sender, noise where two sent",
            "command": f"modlens decode captures/{NAME}/recording.jsonl --line {LINE}",
        }
    )


def main() -> None:
    """Record it."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.recording_two_masters")
    parser.add_argument("--into", type=Path, default=CAPTURES, help="folder of the captures")
    logging.disable(logging.CRITICAL)  # pymodbus logs each collision
    record(parser.parse_args().into)


if __name__ == "__main__":
    main()
