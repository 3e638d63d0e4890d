"""TCP connections packet by packet, and the capture that a mirror port would make of them.

Times are seconds; each packet is an Ethernet frame with IPv4 and TCP, checksums of IP right, those
of TCP left to the network card, as on the capturing host.

    network = Network()
    flow = network.flow("192.168.1.10", "192.168.1.50")
    flow.open(0.0)
    flow.send(0.1, True, b"...")
    network.pcap()
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from random import Random

from tests.doctor.recorded import EPOCH_S

__all__ = ["ACK", "FIN", "RST", "SYN", "Flow", "Network"]

FIN, SYN, RST, PSH, ACK = 0x01, 0x02, 0x04, 0x08, 0x10
WINDOW, MSS = 29_200, 1460
LATENCY_S = 0.0003
MODBUS_PORT = 502


@dataclass(slots=True)
class Network:
    """All packets that pass the mirror port."""

    packets: list[tuple[float, bytes]] = field(default_factory=list)
    flows: list[Flow] = field(default_factory=list)
    port: int = MODBUS_PORT

    def flow(self, client: str, server: str, port: int | None = None) -> Flow:
        """A new connection, from a client's port that nobody has used."""
        made = Flow(self, client, 49_152 + len(self.flows), server, port or self.port)
        self.flows.append(made)
        return made

    def pcap(self) -> bytes:
        """The capture, in the order of time."""
        out = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65_535, 1)
        for time_s, packet in sorted(self.packets, key=lambda one: one[0]):
            seconds, micros = divmod(round((EPOCH_S + time_s) * 1e6), 1_000_000)
            out += struct.pack("<IIII", seconds, micros, len(packet), len(packet)) + packet
        return out


@dataclass(slots=True)
class Flow:
    """One connection; whoever acts says when, and sequence numbers follow."""

    network: Network
    client: str
    client_port: int
    server: str
    port: int
    next_seq: dict[bool, int] = field(init=False)
    last_s: float = 0.0

    def __post_init__(self) -> None:
        """Initial sequence numbers that look like some."""
        rng = Random(f"{self.client}:{self.client_port}")
        self.next_seq = {True: rng.getrandbits(31), False: rng.getrandbits(31)}

    def open(self, at_s: float) -> float:
        """Three packets; the time when it is open."""
        self._packet(at_s, True, SYN)
        self._packet(at_s + LATENCY_S, False, SYN | ACK)
        self._packet(at_s + 2 * LATENCY_S, True, ACK)
        return at_s + 2 * LATENCY_S

    def refused(self, at_s: float) -> float:
        """SYN, and RST instead of an answer."""
        self._packet(at_s, True, SYN)
        self._packet(at_s + LATENCY_S, False, RST | ACK)
        return at_s + LATENCY_S

    def unanswered(self, at_s: float, times: int = 3) -> float:
        """SYN again and again."""
        seq = self.next_seq[True]
        for turn in range(times):
            self.next_seq[True] = seq
            at_s += 2**turn
            self._packet(at_s, True, SYN)
        return at_s

    def send(self, at_s: float, by_client: bool, data: bytes, *, acked: bool = True) -> float:
        """A segment, and the other side's empty acknowledgement a moment later."""
        self._packet(at_s, by_client, PSH | ACK, data)
        if acked:
            self._packet(at_s + LATENCY_S, not by_client, ACK)
        return at_s + LATENCY_S

    def close(self, at_s: float, by_client: bool) -> float:
        """FIN from one side, FIN from the other."""
        self._packet(at_s, by_client, FIN | ACK)
        self._packet(at_s + LATENCY_S, not by_client, FIN | ACK)
        self._packet(at_s + 2 * LATENCY_S, by_client, ACK)
        return at_s + 2 * LATENCY_S

    def half_close(self, at_s: float, by_client: bool) -> float:
        """FIN from one side, which the other has not read yet."""
        self._packet(at_s, by_client, FIN | ACK)
        self._packet(at_s + LATENCY_S, not by_client, ACK)
        return at_s + LATENCY_S

    def reset(self, at_s: float, by_client: bool) -> float:
        """RST."""
        self._packet(at_s, by_client, RST | ACK)
        return at_s

    def _packet(self, at_s: float, by_client: bool, flags: int, data: bytes = b"") -> None:
        ends = [(self.client, self.client_port), (self.server, self.port)]
        (source, source_port), (target, target_port) = ends if by_client else ends[::-1]
        seq, ack = self.next_seq[by_client], self.next_seq[not by_client]
        ack = ack if flags & ACK else 0
        head = struct.pack(
            ">HHIIBBHHH", source_port, target_port, seq, ack, 0x50, flags, WINDOW, 0, 0
        )
        packet = _ethernet(source, target) + _ipv4(source, target, head + data)
        self.network.packets.append((at_s, packet))
        used = len(data) + (1 if flags & (SYN | FIN) else 0)
        self.next_seq[by_client] = (seq + used) & 0xFFFFFFFF
        self.last_s = at_s


def _ethernet(source: str, target: str) -> bytes:
    addresses = (b"\x02\0" + IPv4Address(host).packed for host in (target, source))
    return b"".join(addresses) + b"\x08\0"


def _ipv4(source: str, target: str, payload: bytes) -> bytes:
    ends = IPv4Address(source).packed + IPv4Address(target).packed
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(payload), 0, 0x4000, 64, 6, 0) + ends
    total = sum(word for (word,) in struct.iter_unpack(">H", head))
    total = (total & 0xFFFF) + (total >> 16)
    total = (total & 0xFFFF) + (total >> 16)
    return head[:10] + struct.pack(">H", total ^ 0xFFFF) + head[12:] + payload
