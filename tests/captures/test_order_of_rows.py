"""Rows of several connections come in the order of time, but for requests that came in blocks."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether
from scapy.utils import wrpcap

import modlens

CAPTURES = sorted(Path(__file__).parents[2].joinpath("captures").glob("*/*.pcap*"))
READ = bytes.fromhex("000100000006010300000001")
"""A read of one register of unit 1 with transaction identifier 1."""


def times(path: Path) -> list[str]:
    """The times of all transactions, in the order of their rows."""
    rows = modlens.decode(path).transactions
    return [str(row.time) for row in rows if row.time is not None]


@pytest.mark.parametrize("path", CAPTURES, ids=lambda path: path.parent.name)
def test_times_of_a_capture_do_not_run_back(path: Path) -> None:
    """No capture of this project has a request in blocks."""
    found = times(path)
    assert found
    assert found == sorted(found)


def packet(client: int, sequence: int, payload: bytes, time: float) -> Ether:
    """A segment from a client's port to the server."""
    tcp = TCP(sport=50_000 + client, dport=502, seq=sequence, flags="PA")
    made = Ether() / IP(src=f"10.0.0.{client}", dst="10.0.0.99") / tcp / payload
    made.time = 1_750_000_000 + time
    return made


def test_a_request_in_pieces_stands_where_its_last_piece_came(tmp_path: Path) -> None:
    """Its row may be older than the row in front of it, by as long as its bytes took."""
    packets = [
        packet(1, 1, READ[:5], 0.0),
        packet(2, 1, READ, 0.1),
        packet(3, 1, READ, 0.2),
        packet(1, 6, READ[5:], 0.3),
        packet(2, 13, READ, 0.4),
    ]
    wrpcap(str(tmp_path / "two.pcap"), packets)
    found = times(tmp_path / "two.pcap")
    late = [second for first, second in pairwise(found) if second < first]
    assert len(found) == len(packets) - 1
    assert late == [min(found)]
