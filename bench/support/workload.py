"""Traffic of a polled line, with the truth about it: raw RTU, a log with times, Modbus/TCP.

A master asks ten units by a list of 120 reads, and writes now and then; some requests are refused,
and some are not answered. The bytes are the same on every machine. A block of a megabyte is made
and repeated, with times and numbers that go on.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import _modlens

__all__ = ["BLOCK", "PEER_BYTES", "UNITS", "Truth", "Workload", "frame", "read_truth", "traffic"]

BLOCK = 1 << 20
PEER_BYTES = 1 << 20

POLLS = 120
UNITS = range(1, 11)
READS = (3, 4, 1, 2)
READ_SHARES = (64, 16, 8, 12)
QUANTITIES = {3: (1, 2, 4, 10, 20, 60, 125), 4: (1, 2, 4, 10, 20), 1: (8, 16, 100), 2: (8, 16, 100)}
WRITE_SHARE, EXCEPTION_SHARE, SILENT_SHARE = 0.15, 0.01, 0.005
CHARACTER_NS = 11 * 1_000_000_000 // 115_200
TURN_NS, PAUSE_NS, TIMEOUT_NS = 3_000_000, 5_000_000, 200_000_000
START_NS = 1_700_000_000_000_000_000
REGISTER_READS = (3, 4)

Item = TypeVar("Item")

Exchange = tuple[bytes, bytes | None]
"""A request and its response, each unit and PDU; None where it is not answered."""


def frame(body: bytes) -> bytes:
    """Unit and PDU as an RTU frame."""
    return body + _modlens.crc16(body).to_bytes(2, "little")


@dataclass
class Truth:
    """What is in a recording: frames, requests by what came of them, and the registers read."""

    frames: int = 0
    ok: int = 0
    exception: int = 0
    no_response: int = 0
    registers: int = 0
    register_sum: int = 0

    def count(self, request: bytes, response: bytes | None) -> None:
        """Count an exchange."""
        self.frames += 1 if response is None else 2
        if response is None:
            self.no_response += 1
        elif response[1] & 0x80:
            self.exception += 1
        else:
            self.ok += 1
            if request[1] in REGISTER_READS:
                values = struct.unpack(f">{response[2] // 2}H", response[3:])
                self.registers += len(values)
                self.register_sum += sum(values)

    def times(self, count: int) -> Truth:
        """That of so many repetitions."""
        return Truth(**{name: value * count for name, value in asdict(self).items()})


class Workload:
    """Exchanges of about so many bytes of RTU, which can be written as often as wanted."""

    def __init__(self, size: int = BLOCK, seed: int = 1) -> None:
        rng = random.Random(seed)
        polls = [_poll(rng) for _ in range(POLLS)]
        self.exchanges: list[Exchange] = []
        self.truth = Truth()
        at = 0
        while size > 0:
            if rng.random() < WRITE_SHARE:
                request, response = _write(rng)
            else:
                request, response = _read(rng, polls[at % POLLS])
                at += 1
            answer: bytes | None = response
            if rng.random() < EXCEPTION_SHARE:
                answer = bytes([request[0], request[1] | 0x80, 2])
            elif rng.random() < SILENT_SHARE:
                answer = None
            self.exchanges.append((request, answer))
            self.truth.count(request, answer)
            size -= len(request) + 2 + (0 if answer is None else len(answer) + 2)

    @property
    def equal_pairs_behind_silence(self) -> int:
        """How many requests are answered by the same bytes, after one without a response.

        Nothing but further ones of them is between.
        """
        count, is_behind = 0, False
        for request, response in self.exchanges:
            is_behind = response is None or (is_behind and request == response)
            count += is_behind and response is not None
        return count

    def write_raw(self, path: Path, count: int) -> Path:
        """The bytes as they are on the line."""
        block = b"".join(
            frame(body) for pair in self.exchanges for body in pair if body is not None
        )
        with path.open("wb") as file:
            for _ in range(count):
                file.write(block)
        return path

    def write_log(self, path: Path, count: int) -> Path:
        """A line a frame: seconds since 1970 and the bytes in hex."""
        texts = [
            [None if body is None else frame(body).hex(" ") for body in pair]
            for pair in self.exchanges
        ]
        with path.open("w") as file:
            for time, _, text in self._timed(texts, count):
                file.write(f"{time // 1_000_000_000}.{time // 1000 % 1_000_000:06} {text}\n")
        return path

    def write_capture(self, path: Path, count: int) -> Path:
        """Modbus/TCP over Ethernet as a pcap file: one connection, a packet a message."""
        # Ethernet, IPv4, TCP, MBAP: RFC 894, 791, 9293; messaging on TCP/IP, 3.1.3.
        head = struct.Struct(">12sH BBHHHBBH4s4s HHIIBBHHH HHH")
        stamp = struct.Struct("<IIII")
        ends = ((b"\x0a\0\0\1", 50_000), (b"\x0a\0\0\2", 502))
        sent, number = [1, 1], 0
        with path.open("wb") as file:
            file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262_144, 1))
            for time, side, body in self._timed(self.exchanges, count):
                number += side == 0
                length = 6 + len(body)
                (source, port), (target, other) = ends[side], ends[1 - side]
                ip = (0x45, 0, 40 + length, number & 0xFFFF, 0x4000, 64, 6, 0, source, target)
                tcp = (port, other, sent[side], sent[1 - side], 0x50, 0x18, 8192, 0, 0)
                mbap = (number & 0xFFFF, 0, len(body))
                packet = head.pack(bytes(12), 0x0800, *ip, *tcp, *mbap) + body
                sent[side] = (sent[side] + length) & 0xFFFFFFFF
                seconds, rest = divmod(time, 1_000_000_000)
                file.write(stamp.pack(seconds, rest // 1000, len(packet), len(packet)) + packet)
        return path

    def _timed(
        self, pairs: Sequence[Sequence[Item | None]], count: int
    ) -> Iterator[tuple[int, int, Item]]:
        """Time, side (0 asks) and what `pairs` has for it, message by message."""
        now = START_NS
        for _ in range(count):
            for (request, response), (asked, answered) in zip(self.exchanges, pairs, strict=True):
                now += PAUSE_NS + (len(request) + 2) * CHARACTER_NS
                assert asked is not None
                yield now, 0, asked
                if response is None or answered is None:
                    now += TIMEOUT_NS
                    continue
                now += TURN_NS + (len(response) + 2) * CHARACTER_NS
                yield now, 1, answered


def traffic(size: int) -> list[tuple[bytes, bytes]]:
    """Answered exchanges of about this many bytes, as RTU frames."""
    pairs = Workload(size).exchanges
    return [(frame(request), frame(answer)) for request, answer in pairs if answer is not None]


def read_truth(rows: Iterator[dict[str, str]]) -> Truth:
    """The truth as an export of transactions has it, of all but the frames."""
    found = Truth()
    for row in rows:
        status = row["status"]
        if status == "ok":
            found.ok += 1
            if int(row["function"]) in REGISTER_READS:
                values = list(map(int, row["data"].split()))
                found.registers += len(values)
                found.register_sum += sum(values)
        elif status == "exception":
            found.exception += 1
        else:
            found.no_response += 1
    return found


def _poll(rng: random.Random) -> tuple[int, int, int, int]:
    """Unit, function code, address and quantity."""
    code = rng.choices(READS, READ_SHARES)[0]
    return rng.choice(UNITS), code, rng.randrange(0x1000, 0x2000), rng.choice(QUANTITIES[code])


def _read(rng: random.Random, poll: tuple[int, int, int, int]) -> tuple[bytes, bytes]:
    unit, code, _, quantity = poll
    size = 2 * quantity if code in REGISTER_READS else (quantity + 7) // 8
    data = bytearray(rng.randbytes(size))
    if code not in REGISTER_READS and quantity % 8:
        data[-1] &= 0xFF >> (8 - quantity % 8)
    return struct.pack(">BBHH", *poll), bytes([unit, code, size]) + data


def _write(rng: random.Random) -> tuple[bytes, bytes]:
    unit, address = rng.choice(UNITS), rng.randrange(0x1000, 0x2000)
    if rng.random() < 0.5:  # noqa: PLR2004 - one register or several
        request = struct.pack(">BBHH", unit, 6, address, rng.randrange(0x10000))
        return request, request
    head = struct.pack(">BBHH", unit, 16, address, 10)
    return head + bytes([20]) + rng.randbytes(20), head
