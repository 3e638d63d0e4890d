"""Captures that scapy, editcap and text2pcap write: every link type, tunnel, order and clock."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import UsageError, decode
from tests.conftest import Modlens
from tests.support import captures

scapy = pytest.importorskip("scapy.all")

CLIENT, SERVER = "10.0.0.1", "10.0.0.2"
ASK = bytes.fromhex("0001 0000 0006 11 03 006b 0003")
ANSWER = bytes.fromhex("0001 0000 0009 11 03 06 022b 0000 0064")
DATA = [555, 0, 100]
RTU_ASK = bytes.fromhex("11 03 006b 0003 7687")
RTU_ANSWER = bytes.fromhex("11 03 06 022b 0000 0064 c8ba")

Layers = Callable[[bool], Any]
"""Whether the client sends -> everything up to and with IP."""


def ip(from_client: bool) -> Any:
    """An IPv4 header."""
    ends = (CLIENT, SERVER) if from_client else (SERVER, CLIENT)
    return scapy.IP(src=ends[0], dst=ends[1], id=7 if from_client else 8)


def tcp(from_client: bool, sequence: int, acknowledged: int, data: bytes, flags: str = "PA") -> Any:
    """A TCP segment between a client's port and 502."""
    ports = (50_000, 502) if from_client else (502, 50_000)
    head = scapy.TCP(sport=ports[0], dport=ports[1], seq=sequence, ack=acknowledged, flags=flags)
    return head / scapy.Raw(data) if data else head


def exchange(layers: Layers) -> list[bytes]:
    """A request and its response, as packets."""
    ask = layers(True) / tcp(True, 100, 900, ASK)
    answer = layers(False) / tcp(False, 900, 100 + len(ASK), ANSWER)
    return [bytes(ask), bytes(answer)]


def rows(tmp_path: Path, data: bytes, **options: Any) -> list[Any]:
    """The transactions of a capture with these bytes."""
    path = tmp_path / "capture"
    path.write_bytes(data)
    return list(decode(path, **options))


def ethernet() -> Any:
    """An Ethernet header."""
    return scapy.Ether(src="02:00:00:00:00:01", dst="02:00:00:00:00:02")


def outer() -> Any:
    """What a mirror session puts around a packet."""
    return ethernet() / scapy.IP(src="192.0.2.1", dst="192.0.2.2")


WRAPPED: dict[str, tuple[int, Layers]] = {
    "ethernet": (1, lambda side: ethernet() / ip(side)),
    "vlan": (1, lambda side: ethernet() / scapy.Dot1Q(vlan=5) / ip(side)),
    "qinq": (1, lambda side: ethernet() / scapy.Dot1AD(vlan=5) / scapy.Dot1Q(vlan=6) / ip(side)),
    "ipv6": (
        1,
        lambda side: (
            ethernet()
            / scapy.IPv6(src="fd00::1" if side else "fd00::2", dst="fd00::2" if side else "fd00::1")
        ),
    ),
    "gre": (1, lambda side: outer() / scapy.GRE(proto=0x0800) / ip(side)),
    "gre with key": (
        1,
        lambda side: outer() / scapy.GRE(proto=0x0800, key_present=1, key=9) / ip(side),
    ),
    "vxlan": (
        1,
        lambda side: outer() / scapy.UDP(dport=4789) / scapy.VXLAN(vni=3) / ethernet() / ip(side),
    ),
    "ip in ip": (1, lambda side: outer() / ip(side)),
    "raw ip": (101, ip),
    "ipv4": (228, ip),
    "linux cooked": (113, lambda side: scapy.CookedLinux(proto=0x0800) / ip(side)),
    "linux cooked 2": (276, lambda side: scapy.CookedLinuxV2(proto=0x0800) / ip(side)),
}


@pytest.mark.parametrize("name", WRAPPED)
def test_modbus_is_found_in_all_wrappings(name: str, tmp_path: Path) -> None:
    """As a mirror port or another system delivers it."""
    link, layers = WRAPPED[name]
    (row,) = rows(tmp_path, captures.pcap(link, exchange(layers)))
    server = "[fd00::2]:502" if name == "ipv6" else f"{SERVER}:502"
    assert (row.bus, row.server, row.status, row.data) == (server, server, "ok", DATA)
    assert (row.client, row.connection) == ("fd00::1" if name == "ipv6" else CLIENT, 1)
    assert (row.unit, row.mbap_id, row.address, row.response_time_us) == (17, 1, 107, 10_000)
    assert row.source.endswith("#1")


def inner(side: bool) -> bytes:
    """A whole Ethernet packet of the exchange."""
    return bytes(exchange(lambda which: ethernet() / ip(which))[0 if side else 1])


MIRRORED: dict[str, Callable[[bytes], Any]] = {
    "erspan 1": lambda data: outer() / scapy.GRE(proto=0x88BE) / scapy.Raw(data),
    "erspan 2": lambda data: (
        outer()
        / scapy.GRE(proto=0x88BE, seqnum_present=1, sequence_number=1)
        / scapy.Raw(bytes(8) + data)
    ),
    "erspan 3": lambda data: (
        outer()
        / scapy.GRE(proto=0x22EB, seqnum_present=1, sequence_number=1)
        / scapy.Raw(bytes(12) + data)
    ),
    "mpls": lambda data: (
        scapy.Ether(type=0x8847) / scapy.Raw(bytes.fromhex("00010040 00020140") + data[14:])
    ),
    "pseudowire": lambda data: (
        scapy.Ether(type=0x8847) / scapy.Raw(bytes.fromhex("00010140 00000000") + data)
    ),
}


@pytest.mark.parametrize("name", MIRRORED)
def test_modbus_is_found_behind_mirrors(name: str, tmp_path: Path) -> None:
    """ERSPAN in its three versions, MPLS labels, Ethernet over MPLS."""
    wrap = MIRRORED[name]
    packets = [bytes(wrap(inner(side))) for side in (True, False)]
    (row,) = rows(tmp_path, captures.pcap(1, packets))
    assert (row.status, row.data) == ("ok", DATA)


@pytest.mark.parametrize("six", [False, True])
def test_ip_fragments_are_put_together(six: bool, tmp_path: Path) -> None:
    """IP fragments in any order are reassembled; scapy makes them."""
    layers = WRAPPED["ipv6" if six else "ethernet"][1]
    packets: list[bytes] = []
    for packet in exchange(layers):
        if six:
            whole = scapy.Ether(packet)
            cut = whole[scapy.IPv6]
            head = scapy.IPv6(src=cut.src, dst=cut.dst) / scapy.IPv6ExtHdrFragment(id=len(packets))
            pieces = scapy.fragment6(head / cut.payload, 64)
            packets += [bytes(ethernet() / piece) for piece in reversed(pieces)]
        else:
            whole = scapy.Ether(packet)
            del whole[scapy.IP].len, whole[scapy.IP].chksum
            packets += [bytes(ethernet() / it) for it in reversed(whole[scapy.IP].fragment(16))]
    assert len(packets) > 2
    (row,) = rows(tmp_path, captures.pcap(1, packets))
    assert (row.status, row.data) == ("ok", DATA)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("nano", [False, True])
@pytest.mark.parametrize("kind", ["pcap", "pcapng"])
def test_every_byte_order_and_clock(kind: str, order: str, nano: bool, tmp_path: Path) -> None:
    """Micro- and nanoseconds, little- and big-endian."""
    make = captures.pcap if kind == "pcap" else captures.pcapng
    (row,) = rows(tmp_path, make(228, exchange(ip), order=order, nano=nano))
    assert row.response_time_us == 10_000
    assert row.time.timestamp() == captures.EPOCH


def test_several_interfaces_and_sections(tmp_path: Path) -> None:
    """Each packet is read by the link type of its interface; a section restarts."""
    ask, answer = exchange(ip)
    rtu = captures.idb(147, [(2, b"/dev/ttyUSB0")])
    first = captures.section() + captures.idb(228) + rtu
    first += captures.epb(ask, 1_000_000) + captures.epb(RTU_ASK, 1_000_100, 1)
    second = captures.section(">") + captures.idb(228, order=">")
    second += captures.epb(answer, 1_020_000, order=">")
    found = rows(tmp_path, first + second)
    assert [(row.bus, row.status) for row in found] == [
        (f"{SERVER}:502", "ok"),
        ("/dev/ttyUSB0", "not_observed"),
    ]


def test_a_short_snapshot_length(tmp_path: Path) -> None:
    """The answer is cut: it is no frame, and the device is not blamed for silence."""
    data = captures.pcap(228, exchange(ip), snap=20 + 20 + 12)
    path = tmp_path / "capture"
    path.write_bytes(data)
    frames = list(decode(path).frames)
    assert [frame.verdict for frame in frames] == ["ok", "incomplete"]
    (row,) = decode(path)
    assert row.status in ("bad_response", "not_observed")


@pytest.mark.parametrize("behind", [b"", bytes.fromhex("c8ba")])
def test_udp_with_and_without_the_checksum_behind(behind: bytes, tmp_path: Path) -> None:
    """Modbus over UDP from a gateway that leaves the CRC in the frames."""
    packets = [
        bytes(ip(True) / scapy.UDP(sport=50_000, dport=502) / scapy.Raw(ASK)),
        bytes(ip(False) / scapy.UDP(sport=502, dport=50_000) / scapy.Raw(ANSWER + behind)),
    ]
    (row,) = rows(tmp_path, captures.pcap(228, packets))
    assert (row.status, row.data, row.mode) == ("ok", DATA, "tcp")
    assert ("mbap_length" in row.findings) == bool(behind)


def test_rtu_over_tcp(tmp_path: Path) -> None:
    """A serial server that passes frames on as they are."""
    packets = [
        bytes(ip(True) / tcp(True, 100, 900, RTU_ASK)),
        bytes(ip(False) / tcp(False, 900, 100 + len(RTU_ASK), RTU_ANSWER)),
    ]
    (row,) = rows(tmp_path, captures.pcap(228, packets))
    assert (row.mode, row.status, row.data, row.server) == ("rtu", "ok", DATA, f"{SERVER}:502")


def test_a_device_that_dials_in_is_the_server_all_the_same(tmp_path: Path) -> None:
    """A modem opens the connection to port 502 of the master, which then asks through it."""
    answer = bytes(ip(True) / tcp(True, 100, 900 + len(RTU_ASK), RTU_ANSWER))
    packets = [
        bytes(ip(True) / tcp(True, 99, 0, b"", "S")),
        bytes(ip(False) / tcp(False, 899, 100, b"", "SA")),
        bytes(ip(False) / tcp(False, 900, 100, RTU_ASK)),
        answer,
    ]
    (row,) = rows(tmp_path, captures.pcap(228, packets))
    assert (row.status, row.client, row.server) == ("ok", SERVER, f"{CLIENT}:50000")


def test_an_identifier_of_the_devices_own(tmp_path: Path) -> None:
    """A transaction identifier of 0 in all responses: they are paired, with a finding."""
    own = b"\0\0" + ANSWER[2:]
    packets = [
        bytes(ip(True) / tcp(True, 100, 900, ASK)),
        bytes(ip(False) / tcp(False, 900, 100 + len(ASK), own)),
    ]
    (row,) = rows(tmp_path, captures.pcap(228, packets))
    assert (row.status, row.data, row.findings) == ("ok", DATA, ["transaction_id_mismatch"])


@pytest.mark.parametrize("unit", [0, 255])
def test_units_0_and_255_are_ordinary(unit: int, tmp_path: Path) -> None:
    """Broadcast and reserved numbers are notions of serial lines."""
    mine = bytes([unit])
    packets = [
        bytes(ip(True) / tcp(True, 100, 900, ASK[:6] + mine + ASK[7:])),
        bytes(ip(False) / tcp(False, 900, 100 + len(ASK), ANSWER[:6] + mine + ANSWER[7:])),
    ]
    (row,) = rows(tmp_path, captures.pcap(228, packets))
    assert (row.unit, row.status, row.findings) == (unit, "ok", [])


def test_other_ports(tmp_path: Path, modlens: Modlens) -> None:
    """Other ports are given by number, or found by evidence."""
    packets = []
    for packet in exchange(ip):
        moved = scapy.IP(packet)
        for key in ("sport", "dport"):
            if getattr(moved[scapy.TCP], key) == 502:
                setattr(moved[scapy.TCP], key, 1502)
        packets.append(bytes(moved))
    path = tmp_path / "moved.pcap"
    path.write_bytes(captures.pcap(228, packets))
    assert list(decode(path)) == []
    for words in (("--port", "1502"), ("--port", "503,1502"), ("--port", "any")):
        done = modlens("decode", path, "--to", "csv", "--columns", "bus,status", *words)
        assert done.out.splitlines()[1:] == [f"{SERVER}:1502,ok"]
    assert modlens("decode", path, "--port", "70000").status == 2


def test_what_is_left_out_is_reported(tmp_path: Path, modlens: Modlens) -> None:
    """Encrypted Modbus, other traffic, a packet that the file ends in."""
    secure = ip(True) / scapy.TCP(sport=50_000, dport=802, flags="PA") / scapy.Raw(b"\x16\x03\x03")
    web = ip(True) / scapy.TCP(sport=50_000, dport=443, flags="PA") / scapy.Raw(b"hello")
    data = captures.pcap(228, [bytes(secure), bytes(web), *exchange(ip)])
    path = tmp_path / "mixed.pcap"
    path.write_bytes(data + b"half")
    done = modlens("decode", path)
    assert done.status == 0
    assert "1 skipped: encrypted packets (Modbus over TLS, port 802)" in done.err
    assert "1 skipped: packets of other protocols or ports (try --port)" in done.err
    assert "4 skipped: bytes of an incomplete last packet" in done.err


def test_show_packet(tmp_path: Path, modlens: Modlens) -> None:
    """What begins in it, its registers numbered by the request."""
    path = tmp_path / "poll.pcap"
    path.write_bytes(captures.pcap(228, exchange(ip)))
    done = modlens("show", path, "--packet", "2")
    assert done.status == 0
    assert "frame 2: response, tcp, ok" in done.out
    assert "400110" in done.out
    refused = modlens("show", path, "--packet", "3")
    assert refused.status == 2
    assert "no frame begins in packet 3" in refused.err


def exported(dissector: bytes, pdu: bytes, ports: tuple[int, int] | None = None) -> bytes:
    """A packet of link type 252 as Wireshark and text2pcap write it."""
    tags = [(12, dissector)]
    if ports:
        tags += [
            (24, (3).to_bytes(4)),
            *((25 + n, port.to_bytes(4)) for n, port in enumerate(ports)),
        ]
    head = b"".join(tag.to_bytes(2) + len(value).to_bytes(2) + value for tag, value in tags)
    return head + bytes(4) + pdu


RECIPES = {
    "mbrtu": [exported(b"mbrtu\0\0\0", RTU_ASK), exported(b"mbrtu", RTU_ANSWER)],
    "mbudp": [
        exported(b"mbudp", ASK[:6] + RTU_ASK, (50_000, 502)),
        exported(b"mbudp", ANSWER[:6] + RTU_ANSWER, (502, 50_000)),
    ],
    "mbtcp": [
        exported(b"mbtcp", ASK, (50_000, 502)),
        exported(b"mbtcp", ANSWER, (502, 50_000)),
    ],
}


@pytest.mark.parametrize("name", RECIPES)
def test_exported_pdus(name: str, tmp_path: Path) -> None:
    """The three ways in which serial frames are in captures of link type 252."""
    (row,) = rows(tmp_path, captures.pcapng(252, RECIPES[name]))
    assert (row.status, row.data) == ("ok", DATA)
    assert row.mode == ("tcp" if name == "mbtcp" else "rtu")
    if name != "mbtcp":
        assert row.response_hex == RTU_ANSWER


def test_rtac_serial(tmp_path: Path) -> None:
    """Link type 250: reads with direction; a parity error is a finding."""

    def read(event: int, data: bytes) -> bytes:
        return bytes(8) + bytes([event]) + bytes(3) + data

    packets = [read(1, RTU_ASK), read(2, RTU_ANSWER[:5]), read(8, RTU_ANSWER[5:]), read(0, b"")]
    (row,) = rows(tmp_path, captures.pcap(250, packets))
    assert (row.status, row.data, row.findings) == ("ok", DATA, ["line_error"])
    (unit,) = decode(tmp_path / "capture").doctor()["reserves"]
    assert unit["line_errors"] == 1


def program(name: str) -> str:
    """The path of a program; skips where it is not installed."""
    path = shutil.which(name)
    if path is None:
        if os.environ.get("MODLENS_CI"):
            pytest.fail(f"{name} is not installed")
        pytest.skip(f"{name} is not installed")
    return path


def run(*words: str | Path, text: str | None = None) -> None:
    """A command that has to work."""
    subprocess.run(words, input=text, text=True, check=True, capture_output=True, timeout=60)


def test_text2pcap_and_editcap_write_what_is_read(tmp_path: Path) -> None:
    """Second opinions on the formats: their files, and their conversions of one another."""
    text = "".join(
        f"{0:06x} {frame.hex(' ')}\n{len(frame):06x}\n" for frame in (RTU_ASK, RTU_ANSWER)
    )
    made = tmp_path / "text.pcapng"
    run(program("text2pcap"), "-q", "-P", "mbrtu", "-", made, text=text)
    assert [row.data for row in decode(made)] == [DATA]
    plain = tmp_path / "plain.pcap"
    plain.write_bytes(captures.pcap(228, exchange(ip)))
    for form in ("pcapng", "nsecpcap", "modpcap"):
        other = tmp_path / form
        run(program("editcap"), "-F", form, plain, other)
        (row,) = decode(other)
        assert (row.data, row.response_time_us) == (DATA, 10_000), form


def test_tshark_sees_the_same(tmp_path: Path) -> None:
    """Messages by packet, over a session with cuts, copies and several messages a packet."""
    sent: Sequence[tuple[bool, bytes]] = [
        (True, ASK[:9]), (True, ASK[9:] + ASK), (False, ANSWER + ANSWER[:9]), (False, ANSWER[9:]),
    ]  # fmt: skip
    numbers = {True: 100, False: 900}
    packets = []
    for side, data in sent:
        packets.append(bytes(ip(side) / tcp(side, numbers[side], numbers[not side], data)))
        numbers[side] += len(data)
    path = tmp_path / "session.pcap"
    path.write_bytes(captures.pcap(228, packets))
    words = [program("tshark"), "-r", str(path), "-T", "fields", "-e", "modbus.func_code"]
    done = subprocess.run(words, check=True, capture_output=True, text=True, timeout=120)
    seen = [code for line in done.stdout.splitlines() for code in line.split(",") if code]
    assert seen == ["3"] * 4
    frames = list(decode(path).frames)
    assert [frame.verdict for frame in frames] == ["ok"] * 4
    assert [frame.source.rpartition("#")[2] for frame in frames] == ["1", "2", "3", "3"]
    assert b"".join(frame.hex for frame in frames if frame.direction == "request") == ASK + ASK


def test_captures_of_the_border(tmp_path: Path) -> None:
    """What the core reports about a capture: packets, clock, resolution."""
    core = _modlens.Session(_modlens.Functions())
    number = core.add_capture("x", ports=[])
    core.feed_capture(number, captures.pcap(228, exchange(ip)), final=True)
    assert '"records":2' in core.capture(number)
    assert '"resolution_ns":1000' in core.capture(number)
    with pytest.raises(IndexError, match="capture 7"):
        core.feed_capture(7, b"")


def test_ports_of_the_api(tmp_path: Path) -> None:
    """Single ports, or all of them; an impossible port is refused."""
    name = tmp_path / "other.pcap"
    packets = [bytes(packet) for packet in exchange(lambda sent: ethernet() / ip(sent))]
    moved = []
    for packet in packets:
        one = scapy.Ether(packet)
        side = "dport" if one[scapy.TCP].dport == 502 else "sport"
        setattr(one[scapy.TCP], side, 1502)
        moved.append(bytes(one))
    name.write_bytes(captures.pcap(1, moved))
    assert list(decode(name)) == []
    assert [txn.data for txn in decode(name, ports=[1502])] == [DATA]
    assert [txn.data for txn in decode(name, ports="any")] == [DATA]
    with pytest.raises(UsageError, match="65535"):
        decode(name, ports=[0])


@pytest.mark.parametrize("number", [0, 3])
def test_late_answers_where_transactions_have_no_numbers(number: int, tmp_path: Path) -> None:
    """Devices that send 0 or 3 for ever: unit, function, sizes and order tell what is answered."""

    def adu(pdu: str) -> bytes:
        body = bytes.fromhex(f"11 {pdu}")
        return number.to_bytes(2) + b"\0\0" + len(body).to_bytes(2) + body

    one, two = adu("03 0000 0001"), adu("03 0010 0002")
    of_two, of_one = adu("03 04 0001 0002"), adu("03 02 0007")
    sent = [(True, 100, 900, one), (True, 112, 900, two)]
    sent += [(False, 900, 124, of_two), (False, 900 + len(of_two), 124, of_one)]
    packets = [
        bytes(ethernet() / ip(client) / tcp(client, sequence, acknowledged, data))
        for client, sequence, acknowledged, data in sent
    ]
    # packets are 10 ms apart: the second is answered in time, the first after it and too late
    found = rows(tmp_path, captures.pcap(1, packets), timeout=0.015)
    told = [(txn.status, txn.data, txn.late_response_to, txn.late_response_us) for txn in found]
    assert told == [
        ("no_response", None, None, None),
        ("ok", [1, 2], None, None),
        ("unsolicited", [7], 1, 30_000.0),
    ]


def test_interfaces_without_names_are_different_buses(tmp_path: Path) -> None:
    """Two serial lines of one capture, of which only the number of their interface is known."""
    made = tmp_path / "lines.pcapng"
    wire = [bytes.fromhex("0103006b00037417"), bytes.fromhex("0203006b00037424")]
    start = captures.EPOCH * 1_000_000
    blocks = [captures.epb(data, start + at, at) for at, data in enumerate(wire)]
    made.write_bytes(captures.section() + 2 * captures.idb(147) + b"".join(blocks))
    assert [(row.bus, row.unit) for row in decode(made).frames] == [
        (str(made), 1),
        (f"{made}:2", 2),
    ]
