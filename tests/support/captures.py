"""Capture files, byte by byte, for tests: pcap and pcapng in all their byte orders and clocks."""

from __future__ import annotations

import struct
from collections.abc import Sequence

__all__ = ["EPOCH", "epb", "idb", "pcap", "pcapng", "section"]

EPOCH = 1_700_000_000
"""Seconds since 1970 of the first packet; each further one is 10 ms later."""

STEP_NS = 10_000_000
SNAPLEN = 262_144


def pcap(
    link: int,
    packets: Sequence[bytes],
    *,
    order: str = "<",
    nano: bool = False,
    snap: int = SNAPLEN,
) -> bytes:
    """A pcap file; packets longer than `snap` are cut."""
    magic = 0xA1B23C4D if nano else 0xA1B2C3D4
    out = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, snap, link)
    for number, packet in enumerate(packets):
        seconds, rest = divmod(number * STEP_NS, 1_000_000_000)
        stamp = (EPOCH + seconds, rest if nano else rest // 1000)
        out += struct.pack(f"{order}IIII", *stamp, len(packet[:snap]), len(packet)) + packet[:snap]
    return out


def _block(kind: int, body: bytes, order: str) -> bytes:
    body += bytes(-len(body) % 4)
    length = struct.pack(f"{order}I", len(body) + 12)
    return struct.pack(f"{order}I", kind) + length + body + length


def _options(options: Sequence[tuple[int, bytes]], order: str) -> bytes:
    out = b""
    for code, value in options:
        out += struct.pack(f"{order}HH", code, len(value)) + value + bytes(-len(value) % 4)
    return out + bytes(4) if options else b""


def section(order: str = "<") -> bytes:
    """A section header block."""
    return _block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1), order)


def idb(link: int, options: Sequence[tuple[int, bytes]] = (), order: str = "<") -> bytes:
    """An interface description block."""
    body = struct.pack(f"{order}HHI", link, 0, SNAPLEN) + _options(options, order)
    return _block(1, body, order)


def epb(packet: bytes, ticks: int, interface: int = 0, order: str = "<") -> bytes:
    """An enhanced packet block."""
    head = (interface, ticks >> 32, ticks & 0xFFFFFFFF, len(packet), len(packet))
    return _block(6, struct.pack(f"{order}IIIII", *head) + packet, order)


def pcapng(link: int, packets: Sequence[bytes], *, order: str = "<", nano: bool = False) -> bytes:
    """A pcapng file of one interface."""
    options = [(9, b"\x09")] if nano else []
    out = section(order) + idb(link, options, order)
    for number, packet in enumerate(packets):
        time = EPOCH * 1_000_000_000 + number * STEP_NS
        out += epb(packet, time if nano else time // 1000, order=order)
    return out
