"""A gateway as a model: clients on the network, one serial line, a first-in-first-out queue.

Time is simulated. Faults are planted at single requests, and `Truth` knows for each request of the
network what became of it and which transaction of the line it caused. The line's recording has a
clock of its own.

    truth = GatewayModel(seed=1, faults={"cached": 5, "late_answer": 2}).write(folder)
"""

from __future__ import annotations

import heapq
import json
import random
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tests.support.packets import Packet, write_capture

__all__ = ["GatewayModel", "Truth", "crc", "serial_lines"]

SERVER = "10.0.0.3"
CHAR_S = 11 / 19200
GATEWAY_TIMEOUT_S = 1.0
START_S = 1_700_000_000
UNITS_ADDED = 10
"""The gateway sends requests for unit 1 to unit 11 of its line."""


def crc(data: bytes) -> bytes:
    """The CRC of RTU (serial line, 6.2), low byte first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return struct.pack("<H", register)


def serial_lines(
    frames: list[tuple[float, bytes]], *, shift_s: float = 0.0, drift_ppm: float = 0.0
) -> str:
    """A recording of whole frames, whose times are those of their last stop bit."""
    rows = []
    for end, frame in sorted(frames):
        time = START_S + end * (1 + drift_ppm / 1e6) + shift_s
        rows.append(json.dumps({"t": round(time, 6), "hex": frame.hex()}))
    return "\n".join(rows) + "\n"


@dataclass
class Asked:
    """A request of the network."""

    time: float
    client: str
    number: int
    unit: int
    pdu: bytes
    outcome: str = "forwarded"
    line: int | None = None
    """Which transaction of the line it caused, in order."""
    age_s: float | None = None


@dataclass
class Truth:
    """What happened; `asked` is in the order of time."""

    network: Path
    line: Path
    asked: list[Asked] = field(default_factory=list)


class GatewayModel:
    """Three clients, which poll and sometimes write; each waits for its answer."""

    def __init__(  # noqa: PLR0913 - by keyword
        self,
        *,
        seed: int,
        seconds: float = 600,
        faults: Mapping[str, int] | None = None,
        shift_s: float = 3.0,
        drift_ppm: float = 50.0,
        constant: bool = False,
    ) -> None:
        self._chance = random.Random(seed)
        self._seconds = seconds
        self._faults = dict(faults or {})
        self._shift, self._drift = shift_s, drift_ppm
        self._constant = constant
        self._free = 0.0
        self._packets: list[Packet] = []
        self._frames: list[tuple[float, bytes]] = []
        self._requests_on_line = 0
        self._asked: list[Asked] = []
        self._values: dict[tuple[int, int], int] = {}
        self._seen: dict[tuple[int, bytes], tuple[float, bytes]] = {}
        self._events: list[tuple[float, int, Callable[[float], None]]] = []
        self._ids: dict[str, int] = {}

    def write(self, folder: Path) -> Truth:
        """Run the model and write both recordings."""
        for place, client in enumerate(("10.0.0.21", "10.0.0.22", "10.0.0.23")):
            self._at(0.1 + place * 0.37, lambda time, client=client: self._poll(client, time))  # type: ignore[misc]
        while self._events and self._events[0][0] < self._seconds:
            time, _, action = heapq.heappop(self._events)
            action(time)
        network, line = folder / "network.pcap", folder / "line.jsonl"
        write_capture(network, self._packets, start=START_S)
        text = serial_lines(self._frames, shift_s=self._shift, drift_ppm=self._drift)
        line.write_text(text)
        return Truth(network, line, sorted(self._asked, key=lambda one: one.time))

    def _at(self, time: float, action: Callable[[float], None]) -> None:
        heapq.heappush(self._events, (time, len(self._packets) + len(self._events), action))

    def _request(self, client: str) -> tuple[int, bytes]:
        """What a client asks next: its polls in turn, a write now and then."""
        place = int(client[-1])
        unit = self._chance.choice((1, 2))
        if self._chance.random() < 0.03:
            return unit, struct.pack(">BHH", 6, 107, self._chance.randint(0, 999))
        return unit, struct.pack(">BHH", 3, 10 * self._chance.randint(0, 3) + place, 4)

    def _poll(self, client: str, time: float) -> None:
        unit, pdu = self._request(client)
        one = self._ask(client, unit, pdu, time)
        fault = self._fault(one)
        done = getattr(self, f"_{fault}")(one) if fault else self._forward(one)
        pause = 1.0 + self._chance.uniform(-0.05, 0.05)
        self._at(max(done, time + pause), lambda time: self._poll(client, time))

    def _ask(self, client: str, unit: int, pdu: bytes, time: float) -> Asked:
        number = self._ids[client] = self._ids.get(client, 0) + 1
        one = Asked(time, client, number, unit, pdu)
        self._asked.append(one)
        self._packet(one, pdu, time, to_server=True)
        return one

    def _packet(self, one: Asked, pdu: bytes, time: float, *, to_server: bool) -> None:
        data = struct.pack(">HHHB", one.number & 0xFFFF, 0, len(pdu) + 1, one.unit) + pdu
        ends = (one.client, SERVER) if to_server else (SERVER, one.client)
        self._packets.append(Packet(time, *ends, data, to_server))

    def _fault(self, one: Asked) -> str | None:
        """Which fault is planted at a request, if any is left: faults come ten seconds apart."""
        left = [name for name, count in self._faults.items() if count]
        if not left or one.pdu[0] != 3 or one.time < 20:
            return None
        if one.time < getattr(self, "_last_fault", 0) + 10:
            return None
        name = self._chance.choice(left)
        if name == "cached" and self._seen.get((one.unit, one.pdu), (one.time,))[0] >= one.time:
            return None
        self._faults[name] -= 1
        self._last_fault = one.time
        return name

    def _response(self, one: Asked) -> bytes:
        """What the device says; its registers move."""
        if one.pdu[0] == 6:
            return one.pdu
        _, address, quantity = struct.unpack(">BHH", one.pdu)
        values = []
        for register in range(address, address + quantity):
            key = (one.unit, register)
            move = 0 if self._constant else self._chance.randint(-3, 3)
            self._values[key] = (self._values.get(key, 500 + register * 7) + move) & 0xFFFF
            values.append(self._values[key])
        return struct.pack(f">BB{quantity}H", 3, 2 * quantity, *values)

    def _on_line(self, one: Asked, time: float, pdu: bytes) -> float:
        """Put a frame on the line; gives when its last stop bit has ended."""
        frame = bytes([one.unit + UNITS_ADDED]) + pdu
        end = time + (len(frame) + 2) * CHAR_S
        self._frames.append((end, frame + crc(frame)))
        return end

    def _exchange(self, one: Asked, response: bytes, device_s: float) -> float:
        """Send a request on the line when it is free; gives the end of the response."""
        begin = max(one.time + self._chance.uniform(0.0005, 0.003), self._free + 0.004)
        one.line = self._requests_on_line
        self._requests_on_line += 1
        end = self._on_line(one, begin, one.pdu)
        end = self._on_line(one, end + device_s, response)
        self._free = end
        self._seen[one.unit, one.pdu] = (end, response)
        return end

    def _forward(self, one: Asked) -> float:
        response = self._response(one)
        end = self._exchange(one, response, self._chance.uniform(0.004, 0.03))
        back = end + self._chance.uniform(0.0003, 0.004)
        self._packet(one, response, back, to_server=False)
        return back

    def _dropped(self, one: Asked) -> float:
        """Busy: nothing is forwarded, nothing returned."""
        one.outcome = "dropped"
        return one.time + 2.0

    def _cached(self, one: Asked) -> float:
        one.outcome = "cached"
        since, response = self._seen[one.unit, one.pdu]
        back = one.time + self._chance.uniform(0.0005, 0.002)
        one.age_s = back - since
        self._packet(one, response, back, to_server=False)
        return back

    def _late_answer(self, one: Asked) -> float:
        """The device takes longer than the gateway waits; the gateway keeps what came meanwhile."""
        one.outcome = "gateway_timeout"
        response = self._response(one)
        end = self._exchange(one, response, GATEWAY_TIMEOUT_S + 0.03)
        gave_up = end - len(response + b"uuu") * CHAR_S - 0.03
        self._packet(one, bytes([0x83, 11]), gave_up, to_server=False)
        other = struct.pack(">BHH", 3, 300, 4)
        after = self._ask(one.client, one.unit, other, end + 0.01)
        after.outcome = "late_answer"
        self._exchange(after, self._response(after), 0.02)
        back = after.time + len(other + b"uuu") * CHAR_S + 0.008
        self._packet(after, response, back, to_server=False)
        return self._free + 0.05

    def _wrong_client(self, one: Asked) -> float:
        """Two clients ask at once, and each gets the answer to the other."""
        other = "10.0.0.29"
        two = self._ask(other, one.unit, struct.pack(">BHH", 3, 400, 4), one.time + 0.0005)
        responses = [self._response(one), self._response(two)]
        self._exchange(one, responses[0], 0.01)
        end = self._exchange(two, responses[1], 0.01)
        for asked, response in zip((one, two), reversed(responses), strict=True):
            asked.outcome = "wrong_client"
            self._packet(asked, response, end + 0.002, to_server=False)
        return end + 0.05


if __name__ == "__main__":
    FAULTS = {"dropped": 1, "cached": 1, "late_answer": 1, "wrong_client": 1}
    GatewayModel(seed=4, seconds=70, faults=FAULTS).write(Path("docs/gateway"))
