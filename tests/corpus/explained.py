"""Differences between modlens and TShark, packet by packet: who is right, and why."""

from __future__ import annotations

__all__ = ["EXPLAINED"]

SPLIT = (
    "a message over two packets: TShark counts it where it ends, modlens where it begins"
    " (both are right)"
)
TRAILING = (
    "the header announces three bytes fewer than the device sends; TShark takes them for the next"
    " header and misses the message behind them, modlens finds it (modlens is right)"
)

EXPLAINED: dict[str, dict[int, str]] = {
    "iti__ModbusTCP.pcap": dict.fromkeys((8324, 8334, 8336, 8352), SPLIT),
    "iti__modbus_test_data_part1.pcap": {113: TRAILING},
}
"""Capture -> packet -> reason; packet 0 stands for all of the capture."""
