"""Real gateways between clients and a serial line, recorded on both sides.

    python -m tests.support.gateways pymodbus
    python -m tests.support.gateways mbusd --program build/mbusd
    python -m tests.support.gateways modbus-proxy --program bin/modbus-proxy

Each runs clients for some seconds, joins the two recordings with `modlens join`, and prints how
many transactions of the line were matched, how many with the wrong request, and whether the true
offset and drift lie in the stated intervals. The clock of the line's recording is 3 s ahead and
gains 50 ppm. modbus-proxy has no serial line: its device is reached by Modbus/TCP, and a capture of
that side takes the place of the line's recording.

With `--faults 5` a hostile program (`tests.support.hostile_proxy`) between clients and gateway
plants five faults of each kind, and what `modlens join` calls them is compared.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.support.gateway_model import crc
from tests.support.gateway_programs import GATEWAYS, free_port
from tests.support.hostile_proxy import HostileProxy
from tests.support.packets import Packet, write_capture
from tests.support.ptybus import PtyBus, Sent

__all__ = ["Score", "is_clean", "score", "score_faults"]

SERVER = "10.0.0.3"
SHIFT_S, DRIFT_PPM = 3.0, 50.0
CLIENTS = 3
QUANTITY = 4
LEAST = 25
"""Requests of a client."""
GATEWAY_TIMEOUT_US = 900_000
"""A little less than the second that the gateway of pymodbus waits for the line."""


class Relay:
    """Hands bytes on between clients and a server, and notes each read as a packet."""

    def __init__(self, server: int, names: str = "10.0.0.{}") -> None:
        """Listen at once; the n-th connection is that of client `names`, from 21 on."""
        self.packets: list[Packet] = []
        self.port = free_port()
        self._server, self._names = server, names
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self._lock = threading.Lock()
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """No further connections."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self) -> None:
        number = 21
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(("127.0.0.1", self._server))
                name = self._names.format(number)
                number += 1
                for source, target, to_server in ((client, server, True), (server, client, False)):
                    arguments = (source, target, name, to_server)
                    threading.Thread(target=self._copy, args=arguments, daemon=True).start()

    def _copy(self, source: socket.socket, target: socket.socket, name: str, there: bool) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(4096):
                now = time.time()
                ends = (name, SERVER) if there else (SERVER, name)
                with self._lock:
                    self.packets.append(Packet(now, *ends, data, there))
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)


class Device:
    """Units of which every register has its address as value; the last of four counts the reads."""

    def __init__(self) -> None:
        self.reads = 0

    def response(self, pdu: bytes) -> bytes:
        """The response to a request of function 3 or 6."""
        if pdu[0] == 6:
            return pdu
        _, address, quantity = struct.unpack(">BHH", pdu)
        self.reads += 1
        values = [address + place for place in range(quantity - 1)]
        # Shared registers count, those of one client are constant.
        values.append(self.reads & 0xFFFF if address >= 1000 else address)
        return struct.pack(f">BB{quantity}H", 3, 2 * quantity, *values)


def serve_line(path: str, device: Device, stop: threading.Event) -> None:
    """A device on a serial line: requests have 8 bytes."""
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    os.set_blocking(port, False)
    held = b""
    while not stop.is_set():
        with contextlib.suppress(BlockingIOError):
            held += os.read(port, 256)
        if len(held) >= 8:
            frame, held = held[:8], held[8:]
            if crc(frame[:6]) == frame[6:]:
                time.sleep(0.003)
                answer = frame[:1] + device.response(frame[1:6])
                os.write(port, answer + crc(answer))
            else:
                held = b""
        else:
            time.sleep(0.0005)
    os.close(port)


def serve_network(listener: socket.socket, device: Device) -> None:
    """The same device on the network, for a gateway without a serial line."""
    with contextlib.suppress(OSError):
        while True:
            client, _ = listener.accept()
            while len(head := client.recv(7, socket.MSG_WAITALL)) == 7:
                number, _, length, unit = struct.unpack(">HHHB", head)
                pdu = device.response(client.recv(length - 1, socket.MSG_WAITALL))
                time.sleep(0.003)
                client.sendall(struct.pack(">HHHB", number, 0, len(pdu) + 1, unit) + pdu)


def ask(port: int, place: int, seconds: float) -> None:
    """A client: its own registers in turn, and those that all clients read."""
    end = time.monotonic() + seconds
    with socket.create_connection(("127.0.0.1", port), timeout=5) as line:
        number = 0
        # A busy machine takes longer for what can be judged.
        while time.monotonic() < end or number < LEAST:
            number += 1
            address = 1000 if number % 3 == 0 else 100 * (place + 1) + number % 4 * 10
            pdu = struct.pack(">BHH", 3, address, QUANTITY)
            line.sendall(struct.pack(">HHHB", number, 0, 6, 1) + pdu)
            answer = line.recv(7 + 2 + 2 * QUANTITY, socket.MSG_WAITALL)
            assert answer[7] == 3, answer.hex()
            time.sleep(0.05 + 0.01 * place)


@dataclass
class Score:
    """How many transactions of the line there are, how many were matched, how many wrongly."""

    line: int
    matched: int
    wrong: int
    said: str
    has_true_clocks: bool = False
    """Whether the true offset and drift lie in the stated intervals."""


def score(name: str, folder: Path, *, seconds: float = 10, program: str | None = None) -> Score:
    """Run a gateway and join what was recorded."""
    network, line = record(name, folder, program, lambda port: run_clients(port, seconds))
    command = [sys.executable, "-m", "analyzer", "join", str(network), str(line)]
    done = subprocess.run(
        [*command, "--line", "19200-8E1", "--to", "jsonl"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    rows = [json.loads(text) for text in done.stdout.splitlines()]
    shown = [*command, "--line", "19200-8E1", "-o", str(folder / "joined.csv")]
    said = subprocess.run(shown, capture_output=True, text=True, check=True).stderr
    found = judge(rows, transactions(network), transactions(line), said)
    found.has_true_clocks = are_true(said, seconds)
    return found


CLOCK = re.compile(
    r"is (\S+) s ahead of the network's \(± (\S+) ms\)(?: and gains (\S+) ppm \(± (\S+)\))?"
)


def are_true(said: str, seconds: float) -> bool:
    """Whether offset (in the middle of the recording) and drift are in the intervals of `said`.

    Numbers are rounded to a tenth of a millisecond; the recording begins within a second.
    """
    [(offset, error, drift, drift_error)] = CLOCK.findall(said)
    middle = SHIFT_S + seconds / 2 * DRIFT_PPM / 1e6
    is_offset = abs(float(offset) - middle) <= float(error) / 1e3 + 150e-6
    return is_offset and (not drift or abs(float(drift) - DRIFT_PPM) <= float(drift_error) + 0.1)


def score_faults(
    name: str, folder: Path, *, faults: int, program: str | None = None
) -> dict[str, tuple[int, int]]:
    """Plant faults with a hostile program; gives, of each kind, how many there were and were named.

    `forwarded` are all other requests.
    """
    hostile = HostileProxy(faults)
    network, line = record(name, folder, program, hostile.run, between=hostile.listen)
    command = [sys.executable, "-m", "analyzer", "join", str(network), str(line)]
    done = subprocess.run(
        [*command, "--line", "19200-8E1", "--to", "jsonl"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    said = [row for row in map(json.loads, done.stdout.splitlines()) if row.get("upstream_txn")]
    # An attempt that the gateway repeats, after a second, is no other request.
    said = [row for row in said if row["outcome"] != "repeated"]
    said.sort(key=lambda row: int(row["upstream_txn"]))
    return hostile.compare([(row["upstream_client"], row["outcome"]) for row in said])


def transactions(path: Path) -> dict[int, tuple[str | None, bytes, bytes]]:
    """Client, request and response of each transaction, by its number."""
    return {
        row["txn"]: (
            row.get("client"),
            _pdu(row.get("request_hex", ""), row["mode"]),
            _pdu(row.get("response_hex", ""), row["mode"]),
        )
        for row in exported(path)
    }


def exported(path: Path) -> list[dict[str, Any]]:
    """The rows of transactions."""
    command = [sys.executable, "-m", "analyzer", "export", str(path), "--line", "19200-8E1"]
    done = subprocess.run([*command, "--to", "jsonl"], capture_output=True, text=True, check=True)
    return [json.loads(text) for text in done.stdout.splitlines()]


def is_clean(folder: Path) -> bool:
    """Whether each request on the line has its answer, and no client waited for a second.

    Otherwise the gateway had given up and asked again, because this machine was busy: what it then
    returns to whom is its own mistake.
    """
    line = exported(folder / "line.jsonl")
    waits = [row.get("response_time_us", 0) for row in exported(folder / "network.pcap")]
    return all(row["status"] == "ok" for row in line) and max(waits) < GATEWAY_TIMEOUT_US


def _pdu(text: str, mode: str) -> bytes:
    frame = bytes.fromhex(text)
    return frame[1:-2] if mode == "rtu" else frame[7:]


def judge(
    rows: list[dict[str, object]],
    above: dict[int, tuple[str | None, bytes, bytes]],
    below: dict[int, tuple[str | None, bytes, bytes]],
    said: str,
) -> Score:
    """Compare with what must be: the n-th request for a client's own registers is the n-th there.

    Attempts on the line that the gateway repeats, for want of an answer, are none of these.

    Registers that all clients read count, so the response says which request it was.
    """
    seen: dict[tuple[str, bytes], int] = {}

    def names(side: dict[int, tuple[str | None, bytes, bytes]]) -> dict[int, object]:
        seen.clear()
        found: dict[int, object] = {}
        for number, (_, request, response) in side.items():
            if request[1:3] >= (1000).to_bytes(2, "big"):
                found[number] = response
            else:
                seen["", request] = seen.get(("", request), 0) + 1
                found[number] = (request, seen["", request])
        return found

    below = {number: one for number, one in below.items() if one[2]}
    truth_above, truth_below = names(above), names(below)
    pairs = [(row["txn"], row.get("upstream_txn")) for row in rows if row.get("txn") in below]
    joined = [(one, other) for one, other in pairs if other is not None] if pairs else []
    wrong = sum(truth_below[one] != truth_above[other] for one, other in joined)  # type: ignore[index]
    return Score(len(below), len(joined), wrong, said)


def run_clients(port: int, seconds: float) -> None:
    """Run all clients to their end."""
    clients = [threading.Thread(target=ask, args=(port, n, seconds)) for n in range(CLIENTS)]
    for client in clients:
        client.start()
    for client in clients:
        client.join()
    time.sleep(0.2)


def shifted(seconds: float, start: float) -> float:
    """A time by the clock of the line's recording."""
    return seconds + SHIFT_S + (seconds - start) * DRIFT_PPM / 1e6


def record(
    name: str,
    folder: Path,
    program: str | None,
    clients: Callable[[int], None],
    between: Callable[[int], int] | None = None,
) -> tuple[Path, Path]:
    """Record both sides of a gateway while `clients` use the port that they are given.

    `between` starts a program between them and the gateway's port, and gives its port.
    """

    def above(path: str) -> list[Packet]:
        """The packets between the clients and the gateway on this line."""
        with GATEWAYS[name](path, program) as port:
            relay = Relay(port if between is None else between(port))
            clients(relay.port)
            relay.close()
        return relay.packets

    network = folder / "network.pcap"
    recorded = record_network if name == "modbus-proxy" else record_line
    packets, line = recorded(folder, above)
    write_capture(network, packets, start=0)
    return network, line


def record_line(folder: Path, above: Callable[[str], list[Packet]]) -> tuple[list[Packet], Path]:
    """Record a gateway with a serial line."""
    line = folder / "line.jsonl"
    stop, device, start = threading.Event(), Device(), time.time()
    with PtyBus(["gateway", "unit"], 19200, 11) as bus:
        arguments = (bus.path("unit"), device, stop)
        unit = threading.Thread(target=serve_line, args=arguments)
        unit.start()
        try:
            packets = above(bus.path("gateway"))
        finally:
            stop.set()
            unit.join()
    line.write_text("".join(chunk_line(sent, start) for sent in bus.truth))
    return packets, line


def chunk_line(sent: Sent, start: float) -> str:
    """What a tap records that is never late, as its clock shows it.

    One that reads here would be late by any time where this machine has other work; `modlens join`
    allows for 20 ms.
    """
    time_s = round(shifted(sent.end_ns / 1e9, start), 6)
    return json.dumps({"t": time_s, "hex": sent.data.hex()}) + "\n"


def record_network(folder: Path, above: Callable[[str], list[Packet]]) -> tuple[list[Packet], Path]:
    """Record a gateway whose device is on the network."""
    line, start = folder / "device.pcap", time.time()
    listener = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=serve_network, args=(listener, Device()), daemon=True).start()
    below = Relay(listener.getsockname()[1], "10.0.1.{}")
    packets = above(str(below.port))
    below.close()
    listener.close()
    shifted_packets = [
        Packet(shifted(one.time, start), one.source, one.destination, one.data, one.to_server)
        for one in below.packets
    ]
    write_capture(line, shifted_packets, start=0)
    return packets, line


def main() -> None:
    """Run one gateway and print the score."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("gateway", choices=GATEWAYS)
    parser.add_argument("--program", help="the gateway's program, if it is not on the path")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--faults", type=int, help="plant so many of each kind")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.faults:
            counts = score_faults(
                options.gateway, Path(folder), faults=options.faults, program=options.program
            )
            for kind, (planted, named) in counts.items():
                print(f"{kind}: {named} of {planted} named")  # noqa: T201 - the output
            return
        found = score(
            options.gateway, Path(folder), seconds=options.seconds, program=options.program
        )
    share = 100 * found.matched / max(found.line, 1)
    clocks = "true" if found.has_true_clocks else "not true"
    print(found.said)  # noqa: T201
    print(  # noqa: T201
        f"{found.matched} of {found.line} matched ({share:.2f} %), {found.wrong} wrongly;"
        f" the intervals of the clocks are {clocks}"
    )


if __name__ == "__main__":
    main()
