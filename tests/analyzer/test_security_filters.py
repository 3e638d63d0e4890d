"""Rules of another detector as filters: the traffic of Suricata's Modbus test, and its counts.

The packets are made here from their description (function, address, unit 10; five responses that no
request asked for); the counts are those that suricata-verify expects of its seven rules.
"""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from analyzer import decode
from tests.corpus.score_rules import SURICATA
from tests.support.packets import Packet, write_capture

REQUESTS = (
    *("080004 0000",) * 3, *("080001 0000",) * 3, *("08000A 0000",) * 2, *("2B0E0301",) * 2,
    *("11",) * 2, "0100000001", "0100020002", "0300050002", "050002FF00", "0500010000",
    "0600050001",
)  # fmt: skip
UNASKED = ("8105",) * 5


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("suricata") / "modbus.pcap"
    packets = []
    for number, text in enumerate((*REQUESTS, *UNASKED)):
        pdu, is_request = bytes.fromhex(text), text not in UNASKED
        data = struct.pack(">HHHB", number, 0, len(pdu) + 1, 10) + pdu
        ends = ("10.0.0.57", "10.0.0.3") if is_request else ("10.0.0.8", "10.0.0.57")
        packets.append(Packet(number / 2, *ends, data, is_request))
    write_capture(path, packets)
    return path


@pytest.mark.parametrize(("where", "count"), [row[1:] for row in SURICATA])
def test_the_counts_of_suricata_are_those_of_filters(where: str, count: int, capture: Path) -> None:
    rows = decode(capture).transactions
    assert len(rows) == len(REQUESTS) + len(UNASKED)
    assert len(rows.where(where)) == count
