"""Captures of TCP traffic made packet by packet, without a library: Ethernet, IPv4, TCP."""

from __future__ import annotations

import ipaddress
import struct
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Packet", "write_capture"]

_PORT = 502


@dataclass(frozen=True, slots=True)
class Packet:
    """Data from one host to another at a time in seconds; servers have port 502."""

    time: float
    source: str
    destination: str
    data: bytes
    to_server: bool


def write_capture(path: Path, packets: Iterable[Packet], start: float = 1_700_000_000) -> None:
    """Write packets in the order of their times, with sequence and acknowledgement numbers."""
    sent: defaultdict[tuple[str, str], int] = defaultdict(lambda: 1)
    file = bytearray(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 0xFFFF, 1))
    for packet in sorted(packets, key=lambda one: one.time):
        there, back = (packet.source, packet.destination), (packet.destination, packet.source)
        client = packet.source if packet.to_server else packet.destination
        ports = (40000 + int(client.rsplit(".", 1)[1]), _PORT)
        segment = struct.pack(
            ">HHIIHHHH",
            *(ports if packet.to_server else ports[::-1]),
            *(sent[there], sent[back], 0x5018, 0xFFFF, 0, 0),
        )
        size = 20 + len(segment) + len(packet.data)
        addresses = b"".join(ipaddress.IPv4Address(host).packed for host in there)
        header = struct.pack(">BBHHHBBH", 0x45, 0, size, 0, 0, 64, 6, 0) + addresses
        frame = b"\2" * 12 + b"\x08\0" + header + segment + packet.data
        micros = round((start + packet.time) * 1e6)
        file += struct.pack("<IIII", *divmod(micros, 1_000_000), len(frame), len(frame)) + frame
        sent[there] += len(packet.data)
    path.write_bytes(file)
