"""Lines without Modbus: protocols that are known by their checksums, and lines of another rate."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from tests.doctor.frames import read_request, rtu
from tests.doctor.test_joint import Tape

RUNS = 120


def mstp(rng: Random) -> bytes:
    """A token of BACnet MS/TP; the CRC of ANSI/ASHRAE 135, annex G, by its equations."""
    header = bytes([0, rng.randrange(12), rng.randrange(12), 0, 0])
    crc = 0xFF
    for byte in header:
        crc ^= byte
        crc ^= crc << 1 ^ crc << 2 ^ crc << 3 ^ crc << 4 ^ crc << 5 ^ crc << 6 ^ crc << 7
        crc = (crc & 0xFE) ^ (crc >> 8 & 1)
    return b"\x55\xff" + header + bytes([~crc & 0xFF])


def mbus(rng: Random) -> bytes:
    """An answer of an M-Bus meter."""
    data = bytes([8, rng.randrange(4), 0x72]) + rng.randbytes(14)
    return bytes([0x68, len(data), len(data), 0x68]) + data + bytes([sum(data) % 256, 0x16])


def dlt645(rng: Random) -> bytes:
    """A request to a meter of DL/T 645."""
    frame = b"\x68\x12\x34\x56\x78\x90\x12\x68\x11\x04" + rng.randbytes(4)
    return b"\xfe\xfe\xfe\xfe" + frame + bytes([sum(frame) % 256, 0x16])


@pytest.mark.parametrize(
    ("frame", "name"), [(mstp, "BACnet MS/TP"), (mbus, "M-Bus"), (dlt645, "DL/T 645")]
)
def test_a_line_of_another_protocol_is_named(
    tmp_path: Path, frame: Callable[[Random], bytes], name: str
) -> None:
    tape, rng = Tape(), Random(3)
    for _ in range(RUNS):
        tape.add(frame(rng), 30)
    (found,) = tape.doctor(tmp_path)["diagnoses"]
    assert found["code"] == "foreign_protocol"
    assert name in found["sentence"]


def test_it_is_named_beside_modbus(tmp_path: Path) -> None:
    tape, rng = Tape(), Random(3)
    for number in range(RUNS):
        tape.add(rtu(1, read_request(3, 0, 1)), 30)
        tape.add(rtu(1, bytes([3, 2, number, 7])), 8)
        tape.add(mstp(rng), 30)
    (found,) = tape.doctor(tmp_path)["diagnoses"]
    assert found["code"] == "foreign_protocol"
    assert "BACnet MS/TP" in found["sentence"]


def slower(frame: bytes, times: int) -> bytes:
    """What a receiver makes of the frame that is so many times as fast as the line, 8N1."""
    line = "".join(f"0{byte:08b}"[0] + f"{byte:08b}"[::-1] + "1" for byte in frame)
    bits = "".join(bit * times for bit in line) + "1" * 20
    received, at = bytearray(), 0
    while (at := bits.find("0", at)) >= 0:
        received.append(int(bits[at + 1 : at + 9][::-1], 2))
        at += 9
        at += 0 if bits[at] == "1" else max(0, bits[at:].find("1"))
    return bytes(received)


@pytest.mark.parametrize("times", [2, 4])
def test_a_slower_line_is_no_other_protocol(tmp_path: Path, times: int) -> None:
    """All its frames begin alike, with the unit, and go on differently."""
    tape, rng = Tape(), Random(4)
    for number in range(RUNS):
        address = (0, 16, 300, 1000)[number % 4]
        tape.add(slower(rtu(17, read_request(3, address, 2)), times), 40)
        tape.add(slower(rtu(17, bytes([3, 4, 1, rng.randrange(256), 2, 9])), times), 20)
    (found,) = tape.doctor(tmp_path)["diagnoses"]
    assert found["code"] == "wrong_line_settings"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_requests_that_meet_its_frames_are_not_asked_too_soon(tmp_path: Path, seed: int) -> None:
    """A meter is read on the wires of two units; what comes right after it meets its frame."""
    tape, rng = Tape(), Random(seed)
    for number in range(400):
        meets = False
        if number % 13 == 5:
            tape.add(mbus(rng), 60)
            meets = rng.random() < 0.4
        unit = 1 + number % 2
        tape.add(rtu(unit, read_request(3, 0, 4)), 4 if meets else 60)
        answer = rtu(unit, bytes([3, 8]) + rng.randbytes(8))
        at = rng.randrange(6)
        tape.add(answer[:at] + rng.randbytes(5) + answer[at + 3 :] if meets else answer, 8)
        tape.now += 300_000_000 if meets else 0
    found = tape.codes(tmp_path)
    assert found[:1] == ["foreign_protocol"]
    assert "polled_too_fast" not in found


def test_a_meter_read_where_the_master_pauses_is_no_driver_that_holds_the_line(
    tmp_path: Path,
) -> None:
    """The pause comes after the answers of unit 6, and so does what a meter sends."""
    tape, rng = Tape(), Random(5)
    for number in range(80):
        for unit in (4, 6):
            tape.add(rtu(unit, read_request(3, 16, 2)), 40)
            tape.add(rtu(unit, bytes([3, 4]) + rng.randbytes(4)), 25)
        if number % 2 == 0:
            meter = rng.randrange(1, 9)
            tape.add(bytes([0x10, 0x5B, meter, 0x5B + meter, 0x16]), rng.uniform(100, 500))
            tape.add(mbus(rng), 20)
        tape.now += 400_000_000
    found = tape.doctor(tmp_path)["diagnoses"]
    assert [one["code"] for one in found] == ["foreign_protocol"]
