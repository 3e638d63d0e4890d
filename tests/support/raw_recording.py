"""Reads the raw recordings of a tap: pcapng with a packet for each read, link type 250."""

from __future__ import annotations

__all__ = ["RTAC_HEAD", "bytes_of", "packets"]

BLOCK_HEAD, PACKET_HEAD, RTAC_HEAD = 8, 28, 12


def packets(data: bytes) -> list[tuple[int, int, bytes, bytes]]:
    """Port, time, payload and options of every whole packet block, read as the draft says."""
    found, at = [], 0
    while at + BLOCK_HEAD <= len(data):
        kind, length = (int.from_bytes(data[at + i : at + i + 4], "little") for i in (0, 4))
        if at + length > len(data):
            break
        block = data[at : at + length]
        assert block[-4:] == block[4:8]
        if kind == 6:
            port, high, low, size = (
                int.from_bytes(block[i : i + 4], "little") for i in (8, 12, 16, 20)
            )
            end = PACKET_HEAD + size
            found.append((port, high << 32 | low, block[PACKET_HEAD:end], block[end:-4]))
        at += length
    return found


def bytes_of(data: bytes) -> bytes:
    """The bytes of the line in a recording."""
    return b"".join(payload[RTAC_HEAD:] for _, _, payload, _ in packets(data))
