"""Records the captures of Modbus/TCP with trouble: pymodbus at both ends, a middleman between.

    python -m tests.support.recording_connections

Needs the right to capture on the loopback interface and to listen on port 502 (root). As in
`recording_tcp`, what clients and middleman hand to their sockets is the expectation.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.server import ModbusTcpServer

from tests.support.expected import Frame
from tests.support.middlemen import Idle, Middleman, Mixing, OneBehind, OneClient, OnlyKnown
from tests.support.pymodbus_server import serving
from tests.support.recording import CAPTURES, frame_lines, toml_text
from tests.support.sniffer import Sniffer
from tests.support.trouble_scenarios import Manner, device

PORT, BEHIND, TIMEOUT_S = 502, 5502, 0.25
EXCEPTION_BIT = 0x80

Client = Callable[[], Any]


@dataclass(frozen=True, slots=True)
class Play:
    """What the capture shows, the middleman, and what the clients do."""

    shows: str
    middleman: type[Middleman]
    script: Callable[[Client], None]


def one_client(connect: Client) -> None:
    """One holds the only place while another one knocks, then they change."""
    owner, guest = connect(), connect()
    owner.connect()
    for turn in range(30):
        _read(owner, 1, turn % 3 * 10)
        if turn % 3 == 1:
            _knock(guest)
    owner.close()
    time.sleep(0.05)
    guest.connect()
    for turn in range(10):
        _read(guest, 1, turn % 3 * 10)
        if turn % 3 == 1:
            _knock(owner)
    guest.close()


def idle(connect: Client) -> None:
    """Three reads, a pause that is longer than the server waits, and again."""
    client = connect()
    for _ in range(8):
        for address in (0, 10, 20):
            client.connect()
            _read(client, 1, address)
        time.sleep(0.7)
        client.close()


def one_behind(connect: Client) -> None:
    """Reads of one size."""
    client = connect()
    client.connect()
    for turn in range(40):
        _read(client, 1, turn % 4 * 10)
    client.close()


def mixing(connect: Client) -> None:
    """Two clients in turn, each with a unit of its own."""
    clients = (connect(), connect())
    for client in clients:
        client.connect()
    for turn in range(40):
        for unit, client in enumerate(clients, 1):
            client.connect()
            _read(client, unit, turn % 3 * 10)
    for client in clients:
        client.close()


def wrong_number(connect: Client) -> None:
    """Unit 255 is asked first, then the one that is there."""
    client = connect()
    for turn in range(30):
        client.connect()
        _read(client, 255, turn % 3 * 10)
        client.connect()
        _read(client, 1, turn % 3 * 10)
    client.close()


def connect_each_time(connect: Client) -> None:
    """A connection for each request."""
    for turn in range(50):
        client = connect()
        client.connect()
        _read(client, 1, turn % 3 * 10)
        client.close()
        time.sleep(0.02)


def _read(client: Any, unit: int, address: int) -> None:
    with contextlib.suppress(ModbusException):
        client.read_holding_registers(address, count=6, device_id=unit)


def _knock(client: Any) -> None:
    client.connect()
    time.sleep(0.02)
    client.close()


PLAYS: Mapping[str, Play] = {
    "pymodbus_one_client_only": Play(
        "A server that has one place: a second client is reset right after it was let in, as long "
        "as the first one is connected. Then the second one has the place.",
        OneClient,
        one_client,
    ),
    "pymodbus_idle_close": Play(
        "A server that closes a connection on which nothing was asked for 0.5 s; the client pauses "
        "for 0.7 s and has to connect anew, again and again.",
        Idle,
        idle,
    ),
    "pymodbus_lockstep": Play(
        "The tenth answer does not come; from then on each request is given the answer to the one "
        "before, under its old transaction id, and pymodbus drops it.",
        OneBehind,
        one_behind,
    ),
    "pymodbus_mixed_answers": Play(
        "A gateway with two clients, one for unit 1 and one for unit 2: each fourth request is "
        "given the other client's answer, under the right transaction id and the wrong unit.",
        Mixing,
        mixing,
    ),
    "pymodbus_wrong_unit_number": Play(
        "A gateway behind which unit 1 answers and unit 255 does not exist; the client asks for "
        "both in turn.",
        OnlyKnown,
        wrong_number,
    ),
    "pymodbus_connect_each_time": Play(
        "A client that opens a connection for each request and closes it behind the answer.",
        Middleman,
        connect_each_time,
    ),
}


def served() -> contextlib.AbstractContextManager[None]:
    """A pymodbus server with units 1 and 2 in a thread of its own."""
    devices = [device(1), device(2, Manner(shift=500))]
    return serving(lambda: ModbusTcpServer(devices, address=("127.0.0.1", BEHIND)))


def record(name: str, into: Path) -> None:
    """Record one play."""
    frames: list[Frame] = []

    def note(direction: str, data: bytes) -> None:
        frames.append(_frame(direction, data))

    def trace(sending: bool, data: bytes) -> bytes:
        if sending:
            note("request", data)
        return data

    def connect() -> Any:
        return ModbusTcpClient(
            "127.0.0.1", port=PORT, timeout=TIMEOUT_S, retries=0, trace_packet=trace
        )

    with served(), Sniffer(PORT) as sniffer:
        middleman = PLAYS[name].middleman(PORT, BEHIND, note)
        try:
            PLAYS[name].script(connect)
        finally:
            middleman.close()
    folder = into / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "recording.pcap").write_bytes(sniffer.pcap())
    (folder / "frames.jsonl").write_text(frame_lines(frames), encoding="ascii")
    (folder / "about.toml").write_text(_about(name), encoding="utf-8")


def _frame(direction: str, data: bytes) -> Frame:
    frame: Frame = {
        "line": "A" if direction == "request" else "B",
        "direction": direction,
        "unit": data[6],
        "function": data[7] & ~EXCEPTION_BIT,
    }
    if data[7] & EXCEPTION_BIT:
        frame["exception"] = data[8]
    return {**frame, "verdict": "ok", "hex": data.hex()}


def _about(name: str) -> str:
    python = f"{platform.python_implementation()} {platform.python_version()}"
    return toml_text(
        {
            "name": name,
            "file": "recording.pcap",
            "format": "pcap",
            "origin": "recorded for modlens: python -m tests.support.recording_connections",
            "licence": "MIT, as modlens",
            "mode": "tcp",
            "shows": PLAYS[name].shows,
            "healthy": False,
            "recorded_with": f"pymodbus {version('pymodbus')}, {python}, a middleman of "
            "tests/support/middlemen.py, and tests/support/sniffer.py on Linux' loopback interface",
            "expected_source": "what client and middleman handed to their sockets: the client's "
            "bytes are requests, the middleman's are responses",
            "command": f"modlens decode captures/{name}/recording.pcap",
        }
    )


def main() -> None:
    """Record them again."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.recording_connections")
    parser.add_argument("name", nargs="*", default=list(PLAYS))
    parser.add_argument("--into", type=Path, default=CAPTURES, help="folder of the captures")
    options = parser.parse_args()
    logging.disable(logging.CRITICAL)  # pymodbus logs each answer that was damaged on purpose
    for name in options.name:
        record(name, options.into)


if __name__ == "__main__":
    main()
