"""Security rules: each finds its own example, and ordinary traffic gives none.

The examples are written byte by byte from the specification: checksums by the formula of the
serial line's section 6.2, headers of Modbus/TCP by section 3.1.3 of the messaging guide.
"""

from __future__ import annotations

import json
import struct
import tomllib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

import modlens
from analyzer import security
from analyzer.cli import main
from dissectors.errors import ProfileError
from tests.doctor.network import Flow, Network
from tests.support.packets import Packet, write_capture

Findings = Callable[..., list[dict[str, object]]]

CAPTURES = Path(__file__).parents[2] / "captures"
LINE = ("--line", "19200-8E1")


def crc(data: bytes) -> bytes:
    """The CRC of RTU (serial line, 6.2), low byte first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return struct.pack("<H", register)


Exchange = tuple[float, bytes, bytes | None]
"""Time of the request in seconds, request and response without checksum."""


def recording(path: Path, exchanges: Iterable[Exchange]) -> Path:
    """A recording of a line at 19200 baud: a read for each frame, responses after 20 ms."""
    lines = []
    for time, request, response in exchanges:
        for at, frame in ((time, request), (time + 0.02, response)):
            if frame is not None:
                wire = frame + crc(frame)
                end = 1_700_000_000 + at + len(wire) * 11 / 19200
                lines.append(json.dumps({"t": round(end, 6), "hex": wire.hex()}))
    path.write_text("\n".join(lines) + "\n")
    return path


def read(unit: int, address: int, value: int = 7) -> tuple[bytes, bytes]:
    """A read of one holding register and its response."""
    request = struct.pack(">BBHH", unit, 3, address, 1)
    return request, struct.pack(">BBBH", unit, 3, 2, value)


def polls(count: int, period: float = 0.5, start: float = 0.0) -> Iterator[Exchange]:
    """Ordinary polling of two units."""
    for number in range(count):
        request, response = read(1 + number % 2, 16, number % 5)
        yield start + number * period, request, response


def repeated(pdu: str, count: int, period: float, response: str | None = None) -> list[Exchange]:
    """The same request to unit 1, after ordinary traffic."""
    frame = bytes.fromhex("01" + pdu)
    answer = frame if response is None else bytes.fromhex("01" + response)
    return [*polls(10), *((10 + n * period, frame, answer) for n in range(count))]


def sweep_of_units() -> list[Exchange]:
    return [
        *polls(10),
        *((10 + n, read(40 + n, 0)[0], None) for n in range(20)),
        *polls(200, start=40),
    ]


def sweep_of_addresses() -> list[Exchange]:
    refused = bytes.fromhex("018302")
    sweep = [(10 + n, read(1, 1000 + n)[0], refused) for n in range(8)]
    return [*polls(10), *sweep, *polls(200, start=30)]


def dump_of_registers() -> list[Exchange]:
    dump = [(10 + n * 0.5, *read(1, 1000 + n)) for n in range(80)]
    return [*polls(10), *dump, *polls(200, start=60)]


def sweep_of_functions() -> list[Exchange]:
    tried = [
        (10.0 + n, bytes([1, code]), bytes([1, code | 0x80, 1]))
        for n, code in enumerate((7, 11, 12, 17))
    ]
    return [*polls(10), *tried]


def burst_of_writes() -> list[Exchange]:
    # 19200 baud carries 30 short exchanges a second only; the responses come at once.
    frames = [bytes.fromhex("01060010000" + str(n % 2)) for n in range(40)]
    return [*polls(10), *((10 + n * 0.04, frame, frame) for n, frame in enumerate(frames))]


def identifications() -> list[Exchange]:
    asked = [
        (10.0 + n, bytes([1 + n, 17]), bytes.fromhex(f"{1 + n:02x}1103") + b"\1\xff\x41")
        for n in range(6)
    ]
    return [*polls(10), *asked]


def sweep_of_writes() -> list[Exchange]:
    frames = [struct.pack(">BBHH", 1, 6, 2000 + n, n) for n in range(30)]
    return [
        *polls(10),
        *((10 + n * 0.2, frame, frame) for n, frame in enumerate(frames)),
        *polls(60, start=20),
    ]


def second_responses() -> list[Exchange]:
    """A second device answers three of the requests as well, with another value."""
    second = [(10.0 + n, read(1, 16, 999)[1], None) for n in range(3)]
    asked = [(9.95 + n, *read(1, 16, n)) for n in range(3)]
    return sorted([*polls(10), *asked, *second], key=lambda one: one[0])


def broadcasts() -> list[Exchange]:
    return [*polls(10), (10, bytes.fromhex("000600100001"), None), *polls(10, start=12)]


SERIAL: dict[str, Callable[[], list[Exchange]]] = {
    "listen_only": lambda: [
        *polls(10),
        (10, bytes.fromhex("010800040000"), None),
        *polls(10, start=12),
    ],
    "device_restart": lambda: repeated("0800010000", 2, 1),
    "counters_cleared": lambda: repeated("08000A0000", 2, 1),
    "identification_read": lambda: repeated("11", 1, 1, "110301FF41"),
    "identification_sweep": identifications,
    "diagnostic_echo": lambda: repeated("080000a537", 2, 1),
    "programming_function": lambda: repeated("5A0002", 2, 1, "5A00FE00"),
    "bulk_file_transfer": lambda: repeated("140706000100000002", 30, 0.5, "140705060DFE0020"),
    "unit_sweep": sweep_of_units,
    "address_sweep": sweep_of_addresses,
    "register_dump": dump_of_registers,
    "function_sweep": sweep_of_functions,
    "device_busy_burst": lambda: repeated("0300100001", 4, 2, "8306"),
    "acknowledge_burst": lambda: repeated("0300100001", 4, 2, "8305"),
    "write_burst": burst_of_writes,
    "write_sweep": sweep_of_writes,
    "unasked_responses": second_responses,
    "broadcast_write": broadcasts,
}


@pytest.fixture
def findings(capsys: pytest.CaptureFixture[str]) -> Findings:
    """Runs `modlens security`; gives its rows."""

    def rows(*arguments: str) -> list[dict[str, object]]:
        assert main(["security", *arguments, "--to", "jsonl"]) == 0
        return [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return rows


# Ids of ATT&CK for ICS that version 19 revoked, for sub-techniques of T1691 to T1695
# (attack.mitre.org/docs/subtechniques/ics-sub-techniques-crosswalk.json).
REVOKED = {"T0803", "T0804", "T0805", "T0812", "T0839", "T0855", "T0856", "T0857", "T0891"}
# What the traffic cannot show: docs/security.md.
NOT_CLAIMED = {"T0831", "T0835", "T0837", "T0838", "T0877", "T0880", "T0892"}
# Names of version 19.2; those of sub-techniques begin with that of their technique.
NAMES = {
    "T0801": "Monitor Process State",
    "T0806": "Brute Force I/O",
    "T0814": "Denial of Service",
    "T0816": "Device Restart/Shutdown",
    "T0830": "Adversary-in-the-Middle",
    "T0836": "Modify Parameter",
    "T0843": "Program Download",
    "T0845": "Program Upload",
    "T0846": "Remote System Discovery",
    "T0848": "Rogue Master",
    "T0861": "Point & Tag Identification",
    "T0872": "Indicator Removal on Host",
    "T0885": "Commonly Used Port",
    "T0888": "Remote System Information Discovery",
    "T1691": "Block Operational Technology Message",
    "T1691.002": "Block Operational Technology Message: Reporting Message",
    "T1692.001": "Unauthorized Message: Command Message",
    "T1692.002": "Unauthorized Message: Reporting Message",
}


def test_techniques_have_the_ids_and_names_that_are_in_force() -> None:
    named = dict(rule.technique for rule in security.rules())
    assert not REVOKED & set(named)
    assert not NOT_CLAIMED & set(named)
    assert named == NAMES


@pytest.mark.parametrize("code", sorted(SERIAL))
def test_each_rule_finds_its_example(code: str, tmp_path: Path, findings: Findings) -> None:
    path = recording(tmp_path / "line.jsonl", SERIAL[code]())
    assert code in {row["code"] for row in findings(str(path), *LINE)}


def test_ordinary_polling_gives_no_finding(tmp_path: Path, findings: Findings) -> None:
    # Five of the registers are refused and three units are away, in every cycle: a poll, no sweep.
    def plant() -> Iterator[Exchange]:
        for cycle in range(40):
            for n in range(20):
                time = cycle * 10 + n * 0.4
                if n < 5:
                    yield time, read(1, 500 + n)[0], bytes.fromhex("018302")
                elif n < 8:
                    yield time, read(60 + n, 0)[0], None
                else:
                    yield time, *read(n % 3 + 1, n)

    path = recording(tmp_path / "plant.jsonl", plant())
    assert findings(str(path), *LINE) == []


@pytest.mark.parametrize(
    "name", ["flowmeter_15l_min", "pymodbus_plant", "pymodbus_two_units", "pymodbus_types"]
)
def test_healthy_recordings_give_no_finding(name: str, findings: Findings) -> None:
    about = tomllib.loads((CAPTURES / name / "about.toml").read_text())
    assert about["healthy"]
    assert findings(str(CAPTURES / name / about["file"]), "--line", about["line"]) == []


def capture(path: Path, messages: Iterable[tuple[float, bytes]]) -> Path:
    """A capture of what a client sends to port 502; nobody answers."""
    packets = [
        Packet(time, "10.0.0.9", "10.0.0.3", data, to_server=True) for time, data in messages
    ]
    write_capture(path, packets)
    return path


def adu(number: int, pdu: bytes, *, protocol: int = 0, length: int | None = None) -> bytes:
    size = len(pdu) + 1 if length is None else length
    return struct.pack(">HHHB", number, protocol, size, 1) + pdu


READ = bytes.fromhex("0300100001")
ODD = adu(9, bytes.fromhex("2a0101"), length=3) + b"\1\1\x23"


@pytest.mark.parametrize(
    ("code", "messages"),
    [
        ("not_modbus", [(n, adu(n, READ, protocol=16)) for n in range(4)]),
        ("not_modbus", [(n, b"GET / HTTP/1.1\r\n\r\n" * 30) for n in range(4)]),
        ("excess_bytes", [*((n, adu(n, READ)) for n in range(9)), (9, ODD)]),
        ("request_flood", [(n / 2000, adu(n, READ)) for n in range(1200)]),
    ],
)  # fmt: skip
def test_rules_about_connections(
    code: str, messages: list[tuple[float, bytes]], tmp_path: Path, findings: Findings
) -> None:
    path = capture(tmp_path / "net.pcap", messages)
    rows = findings(str(path))
    assert code in {row["code"] for row in rows}
    assert {row["client"] for row in rows} == {"10.0.0.9"}


ANSWERS = [adu(7, bytes.fromhex(f"0302{value:04x}")) for value in (21, 99)]
"""Two responses to the request 7, with other values."""


def poll(network: Network) -> Flow:
    """A connection on which a request was answered."""
    flow = network.flow("10.0.0.9", "10.0.0.3")
    flow.open(0.0)
    flow.send(1.0, True, adu(7, READ))
    flow.send(1.01, False, ANSWERS[0], acked=False)
    return flow


def contradicting_segment(network: Network) -> None:
    """Somebody sends another response with the server's sequence numbers, after it."""
    flow = poll(network)
    flow.next_seq[False] -= len(ANSWERS[1])
    flow.send(1.02, False, ANSWERS[1])


def contradicting_response(network: Network) -> None:
    """The server's side sends a second response to the same request."""
    poll(network).send(1.02, False, ANSWERS[1])


CONTRADICTIONS = {
    "conflicting_segment": (
        contradicting_segment,
        "packet 7 has 63 from byte 10 on, where 15 had come before",
        [ANSWERS[0]],
    ),
    "conflicting_response": (
        contradicting_response,
        "transaction 1 had another response",
        ANSWERS,
    ),
}
"""By finding: what happens, its detail, and the responses among the frames."""


@pytest.mark.parametrize("code", CONTRADICTIONS)
def test_contradicting_data_is_a_finding_with_both_versions(
    code: str, tmp_path: Path, findings: Findings
) -> None:
    contradict, detail, frames = CONTRADICTIONS[code]
    network = Network()
    contradict(network)
    path = tmp_path / "net.pcap"
    path.write_bytes(network.pcap())
    decoded = modlens.decode(str(path))
    found = [row for row in decoded.findings if row.code == code]
    assert [row.detail for row in found] == [detail]
    assert [row.hex for row in decoded.frames if row.direction == "response"] == frames
    rows = findings(str(path))
    assert [row["code"] for row in rows] == [f"{code}s"]
    assert (rows[0]["client"], rows[0]["severity"]) == ("10.0.0.9", "high")


def test_every_rule_with_a_condition_has_an_example() -> None:
    tried = {*SERIAL, "not_modbus", "excess_bytes", "request_flood"}
    tried |= {"conflicting_segments", "conflicting_responses"}
    assert {rule.code for rule in security.rules() if rule.condition} == tried


def test_rules_of_users(tmp_path: Path, findings: Findings) -> None:
    rules = tmp_path / "own.toml"
    rules.write_text(
        "format = 1\n[[rule]]\ncode = 'pump_write'\ntitle = 'the pump was switched'\n"
        "severity = 'low'\nmeaning = 'x'\nevidence = '{client} switched the pump, {count}.'\n"
        "check = 'x'\nnormal = 'x'\n"
        "where = 'writes(hr, 16)'\n"
    )
    path = recording(tmp_path / "line.jsonl", repeated("0600100001", 3, 1))
    [row] = findings(str(path), *LINE, "--rules", str(rules))
    assert row["sentence"] == "The master switched the pump, 3 times."


@pytest.mark.parametrize(
    ("line", "message"),
    [("where = 'unti == 1'", "unit"), ("colour = 1", "unknown key colour"), ("", "needs where")],
)
def test_a_wrong_rule_is_named(line: str, message: str) -> None:
    texts = "".join(f"{key} = 'x'\n" for key in ("title", "meaning", "evidence", "check", "normal"))
    with pytest.raises(ProfileError, match=message):
        security.load_rules(
            f"format = 1\n[[rule]]\ncode = 'a'\nseverity = 'low'\n{texts}{line}\n", "own.toml"
        )


def test_without_times_it_says_which_rules_were_not_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "line.hex"
    path.write_text("01 03 00 10 00 01 85 CF\n01 03 02 00 07 F9 86\n")
    assert main(["security", str(path)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "Not judged, because the recording has no times" in shown
    assert "write_burst" in shown
