"""Evidence cut out of captures: the packets as they were, and the sum of the whole file."""

from __future__ import annotations

import hashlib
import struct
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether
from scapy.packet import Raw
from scapy.utils import wrpcap

from analyzer import SourceError, decode
from analyzer.columns import TABLES
from analyzer.exports import ExportOptions
from analyzer.exports.original_packets import extract_packets
from analyzer.exports.sink import ExportSink, parse_target
from tests.conftest import CAPTURES, need_program
from tests.support.tshark import environment, fields

NAMES = (
    "frame.time_epoch",
    "frame.comment",
    "frame.packet_flags",
    "frame.interface_name",
    "data.data",
)


def capture(path: Path) -> Path:
    """A capture of a recording with errors."""
    sink = ExportSink(
        parse_target(str(path), "transactions"), columns=None, where=None, growing=False
    )
    for batch in decode(CAPTURES / "pymodbus_disturbed" / "recording.jsonl").batches(*TABLES):
        sink.put(batch)
    sink.close()
    return path


def cut(path: Path, wanted: set[int], out: Path) -> Path:
    """Those packets."""
    out.write_bytes(b"".join(extract_packets(str(path), wanted)))
    return out


def comment_of(path: Path) -> str:
    """What capinfos shows of the section."""
    words = [need_program("capinfos"), str(path)]
    return subprocess.run(words, capture_output=True, text=True, check=True, timeout=60).stdout


def test_packets_of_a_pcapng_are_as_they_were(tmp_path: Path) -> None:
    """Times, comments, flags, interfaces, our own options: block by block the same bytes."""
    whole = capture(tmp_path / "whole.pcapng")
    wanted = {1, 4, 5, 20}
    part = cut(whole, wanted, tmp_path / "part.pcapng")
    every = fields(whole, NAMES)
    assert fields(part, NAMES) == [every[number - 1] for number in sorted(wanted)]
    said = comment_of(part)
    assert hashlib.sha256(whole.read_bytes()).hexdigest() in said
    assert "byte for byte" in said
    assert "modlens" in said
    blocks = [block for block in extract_packets(str(whole), wanted) if block[:4] == b"\6\0\0\0"]
    assert all(block in whole.read_bytes() for block in blocks)


@pytest.mark.parametrize("kind", ["pcap", "nsecpcap"])
def test_packets_of_a_classic_file_keep_times_and_bytes(kind: str, tmp_path: Path) -> None:
    """Classic files with microseconds and with nanoseconds."""
    whole, classic = capture(tmp_path / "whole.pcapng"), tmp_path / "whole.pcap"
    words = [need_program("editcap"), "-F", kind, str(whole), str(classic)]
    subprocess.run(words, check=True, timeout=60, capture_output=True, env=environment(tmp_path))
    part = cut(classic, {2, 3}, tmp_path / "part.pcapng")
    names = ["frame.time_epoch", "mbtcp.trans_id", "modbus.func_code"]
    assert fields(part, names) == fields(classic, names)[1:3]
    assert hashlib.sha256(classic.read_bytes()).hexdigest() in comment_of(part)


def test_a_classic_file_of_the_other_byte_order(tmp_path: Path) -> None:
    """As a machine of another kind wrote it; a last record that is cut ends it."""
    path = tmp_path / "big.pcap"
    head = struct.pack(">IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    record = struct.pack(">IIII", 1_700_000_000, 5, 3, 60)
    path.write_bytes(head + record + b"abc" + record + b"defg"[:2])
    part = cut(path, {1, 2}, tmp_path / "part.pcapng")
    (packet,) = fields(part, ["frame.time_epoch", "frame.len", "frame.cap_len"])
    assert packet["frame.time_epoch"].startswith("1700000000.000005")
    assert (packet["frame.len"], packet["frame.cap_len"]) == ("60", "3")


def test_what_is_no_capture_is_refused(tmp_path: Path) -> None:
    """A text recording is refused, because it has no packets."""
    path = tmp_path / "bus.hex"
    path.write_text("01 03\n")
    with pytest.raises(SourceError, match="must be a pcap or pcapng itself"):
        cut(path, {1}, tmp_path / "part.pcapng")


@pytest.mark.parametrize("cuts", [(9,), (5, 30), (3, 9, 10, 40)])
def test_all_packets_of_a_frame_in_pieces(cuts: tuple[int, ...], tmp_path: Path) -> None:
    """Of an answer in several segments; what comes between them on another connection stays out."""
    values = struct.pack(">30H", *range(30))
    ask, answer = bytes.fromhex("00070000000611 030000001e"), b"\0\7\0\0\0\x3f\x11\3\x3c" + values
    out = Ether() / IP(src="10.0.0.9", dst="10.0.0.1")
    back = Ether() / IP(src="10.0.0.1", dst="10.0.0.9")
    packets = [out / TCP(sport=40000, dport=502, flags="PA", seq=1, ack=1) / Raw(ask)]
    for start, end in pairwise((0, *cuts, len(answer))):
        segment = TCP(sport=502, dport=40000, flags="PA", seq=1 + start, ack=13)
        packets.append(back / segment / Raw(answer[start:end]))
        other = TCP(sport=40001, dport=502, flags="PA", seq=1 + 12 * len(packets), ack=1)
        packets.append(out / other / Raw(ask))
    path, part = tmp_path / "in.pcap", tmp_path / "cut.pcapng"
    wrpcap(str(path), packets)
    wanted = [number for number, packet in enumerate(packets, 1) if 40001 not in ports(packet)]
    assert len(wanted) == len(cuts) + 2
    options = ExportOptions("", (), style="original")
    sink = ExportSink(
        parse_target(str(part), "transactions"),
        columns=None, where="status == 'ok'", growing=False, options=options,
    )  # fmt: skip
    for batch in decode(path).batches(*TABLES):
        sink.put(batch)
    sink.close()
    names = ["frame.time_epoch", "tcp.payload"]
    every = fields(path, names)
    assert fields(part, names) == [every[number - 1] for number in wanted]
    (row,) = decode(part).transactions
    assert row.data == list(range(30))


def ports(packet: Any) -> tuple[int, int]:
    """Of a TCP packet."""
    return packet[TCP].sport, packet[TCP].dport
