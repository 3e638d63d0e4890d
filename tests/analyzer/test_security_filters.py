"""Rules of another detector as filters: the requests of Suricata's Modbus test, and its counts.

The requests are made here from their description (function, address, unit 10); the counts are those
that suricata-verify expects of its seven rules.
"""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from analyzer import decode
from tests.support.packets import Packet, write_capture

REQUESTS = (
    *("080004 0000",) * 3, *("080001 0000",) * 3, *("08000A 0000",) * 2, *("2B0E0301",) * 2,
    *("11",) * 2, "0100000001", "0100020002", "0300050002", "050002FF00", "0500010000",
    "0600050001",
)  # fmt: skip
ASSIGNED = "function in (1, 2, 3, 4, 5, 6, 7, 8, 11, 12, 15, 16, 17, 20, 21, 22, 23, 24, 43)"


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("suricata") / "modbus.pcap"
    packets = []
    for number, text in enumerate(REQUESTS):
        pdu = bytes.fromhex(text)
        data = struct.pack(">HHHB", number, 0, len(pdu) + 1, 10) + pdu
        packets.append(Packet(number / 2, "10.0.0.57", "10.0.0.3", data, True))
    write_capture(path, packets)
    return path


@pytest.mark.parametrize(
    ("where", "count"),
    [
        ("function == 1", 2),
        (ASSIGNED, 18),
        ("read", 3),
        ("unit == 10", 18),
        ("unit == 10 and function == 43", 2),
        # Between its addresses 0 and 2, which count from 1: address 0 on the wire.
        ("unit > 9 and function == 1 and address < 1", 1),
        ("write", 3),
        ("function == 8", 8),
    ],
)
def test_the_counts_of_suricata_are_those_of_filters(where: str, count: int, capture: Path) -> None:
    assert len(decode(capture).transactions.where(where)) == count
