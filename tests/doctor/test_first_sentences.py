"""The first sentence of the doctor says nothing that the text itself contradicts."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.doctor.test_pasted_logs import ANSWER, REQUEST, doctor, mbap

# Application protocol, 6.3, 6.5, 6.6 and 6.12: read, write one coil, one register, several.
READ = bytes([3, 0, 0x6B, 0, 3])
COIL = bytes([5, 0, 0xAC, 0xFF, 0])
REGISTER = bytes([6, 0, 1, 0, 3])
REGISTERS = bytes([16, 0, 1, 0, 2, 4, 0, 10, 1, 2])


def refused(asked: bytes) -> list[str]:
    """The unit answers with exception 3, illegal data value (application protocol, 7)."""
    answer = bytes([asked[0] | 0x80, 3])
    return [
        f"10:00:01.100 Tx: {mbap(1, 1, asked).hex(' ')}",
        f"10:00:01.150 Rx: {mbap(1, 1, answer).hex(' ')}",
    ]


@pytest.mark.parametrize("asked", [COIL, REGISTER])
def test_one_value_that_is_refused_is_no_block(asked: bytes, tmp_path: Path) -> None:
    found = doctor(refused(asked), tmp_path)
    assert "Unit 1 does not allow this value, or not now (exception 3" in found["sentence"]
    said = " ".join(row["sentence"] + row["advice"] + row["proof"] for row in found["diagnoses"])
    assert "too long" not in said
    assert "half" not in said


@pytest.mark.parametrize("asked", [READ, REGISTERS])
def test_several_values_that_are_refused_may_be_too_many(asked: bytes, tmp_path: Path) -> None:
    assert "the block may be too long" in doctor(refused(asked), tmp_path)["sentence"]


def foreign(identifier: int, unit: int, pdu: bytes) -> list[str]:
    """An answer that is not that of the request of identifier 25 to write to unit 1."""
    return [
        f"10:00:01.100 Tx: {mbap(25, 1, REGISTER).hex(' ')}",
        f"10:00:01.150 Rx: {mbap(identifier, unit, pdu).hex(' ')}",
    ]


def test_an_identifier_that_is_right_is_not_called_another_one(tmp_path: Path) -> None:
    """What differs is named: here the unit and the function (messaging on TCP/IP, 4.4.1.4)."""
    sentence = doctor(foreign(25, 0, bytes(20)), tmp_path)["sentence"]
    assert "that is not that of the request" not in sentence
    assert "neither the unit nor the function of its request" in sentence


def test_another_identifier_is_named(tmp_path: Path) -> None:
    sentence = doctor(foreign(77, 1, REGISTER), tmp_path)["sentence"]
    assert "identifier that is not that of the request" in sentence


def test_timeouts_beside_answers_send_nobody_to_the_wires(tmp_path: Path) -> None:
    timeout = "ERROR Connection timed out: select"
    lines = [f"Tx: {REQUEST.hex(' ')}", f"Rx: {ANSWER.hex(' ')}", timeout, timeout]
    sentence = doctor(lines, tmp_path)["sentence"]
    says = "2 lines report that no answer came in time; other requests were answered"
    assert says in sentence
    assert "wires" not in sentence


def test_a_timeout_where_nothing_was_answered_does(tmp_path: Path) -> None:
    lines = [f"Tx: {REQUEST.hex(' ')}", "ERROR Connection timed out: select"]
    assert "power, wires, rate and address" in doctor(lines, tmp_path)["sentence"]


def test_a_path_in_a_log_is_no_other_protocol(tmp_path: Path) -> None:
    path = "Open port COM5 (C:\\Program Files\\Monitor Software\\Serial Port\\Serial.exe)"
    lines = [path, f"Tx: {REQUEST.hex(' ')}", f"Rx: {ANSWER.hex(' ')}"]
    assert "protocol" not in doctor(lines, tmp_path)["sentence"]
