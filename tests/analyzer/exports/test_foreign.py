"""Captures that other programs have written: scapy, text2pcap, tshark, editcap, mergecap."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest
from scapy.layers.inet import IP, TCP, UDP
from scapy.layers.l2 import Ether
from scapy.packet import Raw
from scapy.utils import PcapNgWriter, PcapWriter

import _modlens
from analyzer import decode
from tests.analyzer.exports.test_wireshark import export, recording, styled
from tests.conftest import need_program
from tests.support.tshark import environment

REQUEST, RESPONSE = (
    bytes.fromhex("00070000000611 03006b0003"),
    bytes.fromhex("00070000000911 0306ae4156524340"),
)
"""The example of the specification (6.3), on TCP."""

WORDS = [0xAE41, 0x5652, 0x4340]


def rtu(adu: bytes) -> bytes:
    """An RTU frame: unit and PDU of a Modbus/TCP frame with a CRC."""
    body = adu[6:]
    return body + _modlens.crc16(body).to_bytes(2, "little")


def packets(kind: Any) -> list[Any]:
    """Request and response between two hosts, 20 ms apart."""
    there = Ether() / IP(src="10.0.0.9", dst="10.0.0.1")
    back = Ether() / IP(src="10.0.0.1", dst="10.0.0.9")
    if kind is TCP:
        found = [
            there / TCP(sport=40000, dport=502, flags="PA", seq=1, ack=1) / Raw(REQUEST),
            back / TCP(sport=502, dport=40000, flags="PA", seq=1, ack=13) / Raw(RESPONSE),
        ]
    else:
        found = [
            there / UDP(sport=40000, dport=502) / Raw(REQUEST),
            back / UDP(sport=502, dport=40000) / Raw(RESPONSE),
        ]
    for number, packet in enumerate(found):
        packet.time = 1_700_000_000 + number / 50
    return found


@pytest.mark.parametrize("kind", [TCP, UDP])
@pytest.mark.parametrize(
    ("writer", "words"),
    [
        (PcapWriter, {}),
        (PcapWriter, {"nano": True}),
        (PcapWriter, {"endianness": ">"}),
        (PcapWriter, {"gz": True}),
        (PcapNgWriter, {}),
    ],
    ids=["pcap", "nanoseconds", "big-endian", "gzip", "pcapng"],
)
def test_scapy(kind: Any, writer: Any, words: dict[str, Any], tmp_path: Path) -> None:
    """Classic pcap in all its variants, and pcapng, as scapy writes them."""
    path = tmp_path / "one.cap"
    with writer(str(path), **words) as out:
        for packet in packets(kind):
            out.write(packet)
    found = decode(path)
    assert [row.hex for row in found.frames] == [REQUEST, RESPONSE]
    (row,) = found.transactions
    assert (row.status, row.unit, row.address, row.data) == ("ok", 17, 0x6B, WORDS)
    assert (row.client, row.server) == ("10.0.0.9", "10.0.0.1:502")
    assert row.response_time_us == pytest.approx(20_000, abs=1)


def test_scapy_with_bare_frames(tmp_path: Path) -> None:
    """Bare frames with link type 147, as serial sniffers write them."""
    path = tmp_path / "serial.pcap"
    with PcapWriter(str(path), linktype=147) as out:
        for frame in (REQUEST, RESPONSE):
            out.write(rtu(frame))
    found = decode(path)
    assert [row.hex for row in found.frames] == [rtu(REQUEST), rtu(RESPONSE)]
    assert [row.data for row in found.transactions] == [WORDS]


def run(folder: Path, *words: str) -> None:
    """A program of Wireshark's, which must succeed."""
    subprocess.run(
        [need_program(words[0]), *words[1:]], check=True, timeout=60, capture_output=True,
        env=environment(folder),
    )  # fmt: skip


def hexdump(*frames: bytes) -> str:
    """Packets as text2pcap reads them."""
    return "".join(f"000000 {frame.hex(' ')}\n" for frame in frames)


@pytest.mark.parametrize("form", ["pcapng", "pcap", "nsecpcap"])
def test_text2pcap(form: str, tmp_path: Path) -> None:
    """RTU for the dissector mbrtu, as in our style rtu; and TCP with headers that it makes."""
    text, path = tmp_path / "hex.txt", tmp_path / "one.cap"
    text.write_text(hexdump(rtu(REQUEST), rtu(RESPONSE)))
    run(tmp_path, "text2pcap", "-F", form, "-P", "mbrtu", str(text), str(path))
    found = decode(path)
    assert [row.hex for row in found.frames] == [rtu(REQUEST), rtu(RESPONSE)]
    assert [row.data for row in found.transactions] == [WORDS]
    text.write_text(hexdump(REQUEST))
    run(tmp_path, "text2pcap", "-F", form, "-T", "40000,502", str(text), str(path))
    assert [row.hex for row in decode(path).frames] == [REQUEST]


@pytest.mark.parametrize("form", ["pcap", "nsecpcap", "pcapng"])
@pytest.mark.parametrize("style", ["udp", "rtu", "tcp"])
def test_editcap_and_tshark(style: str, form: str, tmp_path: Path) -> None:
    """Ours, in another format: the frames stay, classic pcap has no words of ours."""
    source = recording("pymodbus_two_units")
    path = export(source, tmp_path / "one.pcapng", options=styled(style))
    meant = [row.hex for row in decode(path).frames]
    run(tmp_path, "editcap", "-F", form, str(path), str(tmp_path / "edited.cap"))
    run(tmp_path, "tshark", "-F", form, "-r", str(path), "-w", str(tmp_path / "saved.cap"))
    for name in ("edited.cap", "saved.cap"):
        assert [row.hex for row in decode(tmp_path / name).frames] == meant, name


def test_mergecap(tmp_path: Path) -> None:
    """Two captures of ours in one file: both buses keep their names."""
    names = ("pymodbus_two_units", "pymodbus_broadcast")
    paths = [export(recording(name), tmp_path / f"{name}.pcapng") for name in names]
    run(tmp_path, "mergecap", "-a", "-w", str(tmp_path / "both.pcapng"), *map(str, paths))
    found = decode(tmp_path / "both.pcapng")
    meant = [row.hex for name in names for row in recording(name).frames]
    assert [row.hex for row in found.frames] == meant
    assert len({row.bus for row in found.frames}) == 2
