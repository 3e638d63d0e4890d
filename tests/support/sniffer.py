"""Records what passes the loopback interface of Linux into a pcap file. Needs root.

with Sniffer(502) as sniffer:
    ...
sniffer.pcap()
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from typing import Self

__all__ = ["Sniffer"]

ALL_PROTOCOLS, OUTGOING, LARGEST = 3, 4, 65_535
SETTLE_S = 0.3
ETHERNET, IPV4 = 14, 20


class Sniffer:
    """TCP packets to and from a port; used by `with`."""

    def __init__(self, port: int) -> None:
        """Nothing is opened yet."""
        self._port = port
        self._packets: list[tuple[int, bytes]] = []
        self._stopping = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_PROTOCOLS))

    def __enter__(self) -> Self:
        """Listen."""
        self._socket.bind(("lo", 0))
        self._socket.settimeout(SETTLE_S / 3)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Wait for what is still on its way."""
        time.sleep(SETTLE_S)
        self._stopping = True
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while not self._stopping:
            try:
                packet, origin = self._socket.recvfrom(LARGEST)
            except TimeoutError:
                continue
            # Each packet is seen when it leaves and when it comes back.
            if origin[2] != OUTGOING and self._is_ours(packet):
                self._packets.append((time.time_ns(), packet))

    def _is_ours(self, packet: bytes) -> bool:
        is_tcp = packet[12:14] == b"\x08\0" and packet[ETHERNET + 9] == socket.IPPROTO_TCP
        at = ETHERNET + IPV4
        return is_tcp and self._port in struct.unpack(">HH", packet[at : at + 4])

    def pcap(self) -> bytes:
        """The capture, with microseconds."""
        out = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, LARGEST, 1)
        for time_ns, packet in self._packets:
            seconds, micros = divmod(time_ns // 1000, 1_000_000)
            out += struct.pack("<IIII", seconds, micros, len(packet), len(packet)) + packet
        return out
