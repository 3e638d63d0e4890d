"""Records captures/pymodbus_tcp: pymodbus' TCP client and server on this machine, seen by tcpdump.

    python -m tests.support.recording_tcp

Needs the right to capture on the loopback interface and to listen on port 502 (root). What both
ends handed to their sockets (hook trace_packet) is the expectation; the capture itself is not
looked at by anything of modlens.
"""

from __future__ import annotations

import argparse
import contextlib
import platform
import subprocess
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.server import ModbusTcpServer

from tests.support.devices import FLOATS_ADDRESS, demo_device, identity, prime_counters
from tests.support.expected import Frame
from tests.support.pymodbus_server import serving
from tests.support.recording import CAPTURES, frame_lines, toml_text

NAME = "pymodbus_tcp"
UNIT, PORT, CAPTURE_S = 1, 502, 0.5
EXCEPTION_BIT = 0x80
SHOWS = (
    "One connection to port 502: reads of registers and bits, writes, a read of an address that is "
    "not there (exception 2), device identification in several parts. Transaction numbers count."
)


def script(client: Any) -> Iterator[Callable[[], object]]:
    """What the client does."""
    for turn in range(4):
        yield lambda: client.read_holding_registers(0, count=10, device_id=UNIT)
        yield lambda: client.read_input_registers(FLOATS_ADDRESS, count=6, device_id=UNIT)
        yield lambda: client.read_coils(0, count=12, device_id=UNIT)
        yield partial(client.write_register, 6, 1400 + turn, device_id=UNIT)
    yield lambda: client.write_registers(6, [1, 2, 3], device_id=UNIT)
    yield lambda: client.write_coils(0, [True, False, True], device_id=UNIT)
    yield lambda: client.mask_write_register(address=6, and_mask=0xF2, or_mask=0x25, device_id=UNIT)
    yield lambda: client.readwrite_registers(
        read_address=0, read_count=4, write_address=6, values=[7, 8], device_id=UNIT
    )
    yield lambda: client.read_holding_registers(60_000, count=2, device_id=UNIT)
    yield lambda: client.read_device_information(read_code=1, object_id=0, device_id=UNIT)


def served(note: Callable[[bool, bytes], bytes]) -> contextlib.AbstractContextManager[None]:
    """A server in a thread of its own."""
    return serving(
        lambda: ModbusTcpServer(
            demo_device(UNIT),
            identity=identity(),
            address=("127.0.0.1", PORT),
            trace_packet=note,
        )
    )


def record(into: Path) -> list[Frame]:
    """Records into the folder; gives the frames that both ends say they sent, in their order."""
    prime_counters()
    frames: list[Frame] = []

    def noted(direction: str) -> Callable[[bool, bytes], bytes]:
        def note(sending: bool, data: bytes) -> bytes:
            if sending:
                frames.append(_frame(direction, data))
            return data

        return note

    file = str(into / "recording.pcap")
    command = ["tcpdump", "--immediate-mode", "-i", "lo", "-U", "-w", file, f"tcp port {PORT}"]
    capture = subprocess.Popen(command, stderr=subprocess.PIPE)
    try:
        assert capture.stderr is not None
        capture.stderr.readline()  # it listens
        with served(noted("response")):
            client: Any = ModbusTcpClient(
                "127.0.0.1", port=PORT, trace_packet=noted("request"), retries=0
            )
            client.connect()
            for step in script(client):
                with contextlib.suppress(ModbusException):
                    step()
            client.close()
        time.sleep(CAPTURE_S)
    finally:
        capture.terminate()
        capture.communicate()
    return frames


def _frame(direction: str, data: bytes) -> Frame:
    function = data[7]
    frame: Frame = {
        "line": "A" if direction == "request" else "B",
        "direction": direction,
        "unit": data[6],
        "function": function & ~EXCEPTION_BIT,
    }
    if function & EXCEPTION_BIT:
        frame["exception"] = data[8]
    return {**frame, "verdict": "ok", "hex": data.hex()}


def main() -> None:
    """Record it again."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.recording_tcp")
    parser.add_argument("--into", type=Path, default=CAPTURES, help="folder of the captures")
    folder = parser.parse_args().into / NAME
    folder.mkdir(parents=True, exist_ok=True)
    frames = record(folder)
    (folder / "frames.jsonl").write_text(frame_lines(frames), encoding="ascii")
    python = f"{platform.python_implementation()} {platform.python_version()}"
    about: dict[str, str | bool] = {
        "name": NAME,
        "file": "recording.pcap",
        "format": "pcap",
        "origin": "recorded for modlens: python -m tests.support.recording_tcp",
        "licence": "MIT, as modlens",
        "mode": "tcp",
        "shows": SHOWS,
        "healthy": True,
        "recorded_with": f"pymodbus {version('pymodbus')}, {python}, tcpdump on the loopback"
        " interface of Linux",
        "expected_source": "what each participant's own pymodbus handed to its socket (hook"
        " trace_packet): the client's bytes are requests, the server's are responses",
        "command": f"modlens decode captures/{NAME}/recording.pcap",
    }
    (folder / "about.toml").write_text(toml_text(about), encoding="utf-8")


if __name__ == "__main__":
    main()
