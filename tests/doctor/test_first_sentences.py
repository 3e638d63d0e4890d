"""The first sentence of the doctor says nothing that the text itself contradicts."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.doctor.frames import rtu
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
    says = "2 lines report that no answer came in time, and what is printed here was answered"
    assert says in sentence
    assert "wires" not in sentence


def chunk(action: str, data: bytes) -> list[str]:
    """Print a chunk as a log of Node.js does."""
    return [
        f"  modbus-serial {{ action: '{action} serial ascii port',",
        f"  modbus-serial   data: <Buffer {data.hex(' ')}> }} +5ms",
    ]


def test_an_ascii_answer_that_is_cut_is_compared_with_what_was_asked(tmp_path: Path) -> None:
    # Three registers have 6 bytes. 11 03 00 00 00 03 has the LRC E9.
    asked = chunk("send", b":110300000003E9\r\n")
    for announced, says in (
        (b":11030C00", "is 12, and 6 is due"),
        (b":11030400", "is 4, and 6 is due"),
    ):
        sentence = doctor([*asked, *chunk("receive", announced)], tmp_path)["sentence"]
        assert says in sentence
        assert "as far as it goes" not in sentence
    # The count is that of the request: characters are not counted against bytes.
    sentence = doctor([*asked, *chunk("receive", b":11030600")], tmp_path)["sentence"]
    assert "as far as it goes" in sentence
    assert "bytes are there" not in sentence


def test_a_timeout_that_is_set_is_none(tmp_path: Path) -> None:
    for setting in ("worker started, timeout=2500", "Timeout setting: 850.0 ms"):
        lines = [setting, f"Tx: {REQUEST.hex(' ')}", f"Rx: {ANSWER.hex(' ')}"]
        assert "in time" not in doctor(lines, tmp_path)["sentence"]


def test_a_timeout_where_nothing_was_answered_does(tmp_path: Path) -> None:
    lines = [f"Tx: {REQUEST.hex(' ')}", "ERROR Connection timed out: select"]
    assert "power, wires, rate and address" in doctor(lines, tmp_path)["sentence"]


def test_a_path_in_a_log_is_no_other_protocol(tmp_path: Path) -> None:
    path = "Open port COM5 (C:\\Program Files\\Monitor Software\\Serial Port\\Serial.exe)"
    lines = [path, f"Tx: {REQUEST.hex(' ')}", f"Rx: {ANSWER.hex(' ')}"]
    assert "protocol" not in doctor(lines, tmp_path)["sentence"]


# Application protocol, 6.3 and 6.4: three registers, and ten.
ASKED = rtu(3, bytes([4, 0, 8, 0, 3]))
TEN = bytes([3, 0, 0, 0, 10])


def said(lines: list[str], folder: Path) -> str:
    sentence = doctor(lines, folder)["sentence"]
    assert isinstance(sentence, str)
    return sentence


@pytest.mark.parametrize("mask", ["e0f0c007807c0840", "1008604010018403"])
def test_a_request_that_comes_back_distorted_is_the_own_one(mask: str, tmp_path: Path) -> None:
    """Bits that were sent as 0 come as 1, all over the frame: a level, not the answer of a unit."""
    heard = bytes(one | other for one, other in zip(ASKED, bytes.fromhex(mask), strict=True))
    sentence = said([f"TX: {ASKED.hex(' ')}", f"RX: {heard.hex(' ')}"] * 2, tmp_path)
    assert "the request itself with some bits changed" in sentence


def test_other_bytes_of_that_length_are_not(tmp_path: Path) -> None:
    sentence = said([f"TX: {ASKED.hex(' ')}", "RX: 9a 3c e1 55 47 b2 0d 66"] * 2, tmp_path)
    assert "does not begin with the unit and the function" in sentence


def test_an_answer_over_tcp_that_stops_is_cut(tmp_path: Path) -> None:
    """Its header announces 23 bytes, and 9 came (messaging on TCP/IP, 3.1.3)."""
    answer = mbap(1, 1, bytes([3, 20, *range(20)]))[: 6 + 9]
    lines = [f"SEND: {mbap(1, 1, TEN).hex(' ')}", f"RECV: {answer.hex(' ')}", "timed out"]
    sentence = said(lines, tmp_path)
    assert "The answer of unit 1 is right as far as it goes and stops before its end" in sentence


def test_text_behind_a_header_is_no_answer_that_was_cut(tmp_path: Path) -> None:
    answer = bytes.fromhex("000100000004 01") + b"OK"
    sentence = said([f"Tx: {mbap(1, 1, TEN).hex(' ')}", f"Rx: {answer.hex(' ')}"], tmp_path)
    assert "of another function than the request" in sentence


@pytest.mark.parametrize(("count", "is_limit"), [(0, True), (126, True), (125, False)])
def test_a_quantity_beyond_the_protocol_is_named(
    count: int, is_limit: bool, tmp_path: Path
) -> None:
    """1 to 125 registers are read at once (application protocol, 6.3)."""
    sentence = said(refused(bytes([3, 0, 0, 0, count])), tmp_path)
    assert ("a quantity that the protocol does not allow" in sentence) is is_limit
    assert ("the block may be too long" in sentence) is not is_limit


def test_nobody_answers_what_is_for_all_units(tmp_path: Path) -> None:
    """Serial line, 2.1: unit 0 is broadcast, and no answer is returned."""
    lines = [f"TX: {rtu(0, REGISTER).hex(' ')}", "Error: timeout, no response"]
    sentence = said(lines, tmp_path)
    assert "to unit 0, that is to all units, and none answers that" in sentence
    assert "wires" not in sentence
    lines = [f"TX: {rtu(1, REGISTER).hex(' ')}", "Error: timeout, no response"]
    assert "power, wires" in said(lines, tmp_path)


def test_an_answer_of_another_function_is_no_second_device(tmp_path: Path) -> None:
    """A refusal of function 16 whose function byte is 01 in place of 90."""
    lines = [f"TX: {rtu(9, REGISTERS).hex(' ')}", f"RX: {rtu(9, bytes([1, 0])).hex(' ')}"]
    assert "The answer is of another function than the request" in said(lines, tmp_path)


def test_a_byte_in_front_explains_that_the_last_one_is_missing(tmp_path: Path) -> None:
    answer = rtu(3, bytes([4, 6, 0, 1, 0, 2, 0, 3]))
    asked = f"TX: {ASKED.hex(' ')}"
    sentence = said([asked, f"RX: {(bytes([0x1D]) + answer[:-1]).hex(' ')}"], tmp_path)
    assert "A stray byte came before the answer" in sentence
    assert "lacks its last byte" in said([asked, f"RX: {answer[:-1].hex(' ')}"], tmp_path)


@pytest.mark.parametrize(
    "words",
    [
        "The ideal answer would be: ",
        "Expected: ",
        "Die Antwort sollte lauten: ",
        "La réponse attendue: ",
        "La respuesta debería ser: ",
        "Должно быть: ",
        "正确的应该是: ",
        "From the manual, as an example:\n",
        "const uint8_t expected[] = ",
    ],
)
def test_an_answer_that_only_should_have_come_is_none(words: str, tmp_path: Path) -> None:
    """What came is cut; the whole answer below it was never on the line."""
    lines = [f"TX: {REQUEST.hex(' ')}", f"RX: {ANSWER[:7].hex(' ')}", words + ANSWER.hex(" ")]
    assert "stops before its end" in said(lines, tmp_path)


def test_what_the_other_side_received_is_compared_with_the_request(tmp_path: Path) -> None:
    """The highest bit of each byte is lost: seven data bits in place of eight."""
    asked = rtu(0x81, bytes([3, 0, 0xC8, 0, 2]))
    heard = bytes(byte & 0x7F for byte in asked)
    lines = [f"Sent      : {asked.hex(' ')}", f"Slave got : {heard.hex(' ')}"]
    sentence = said(lines, tmp_path)
    assert "request" in sentence
    assert "with some bits changed" in sentence


def test_a_request_without_answer_beside_others_is_named(tmp_path: Path) -> None:
    other = rtu(8, bytes([3, 0, 0, 0, 1]))
    lines = [f"TX: {other.hex(' ')}", "RX:", f"TX: {REQUEST.hex(' ')}", f"RX: {ANSWER.hex(' ')}"]
    assert "No answer of unit 8 is in the recording" in said(lines, tmp_path)
    # The last one may have been answered after the end of the text.
    sentence = said([*lines[2:], lines[0]], tmp_path)
    assert "no answer to another one is in the recording" in sentence


def test_a_request_that_is_repeated_alone_is_no_echo(tmp_path: Path) -> None:
    """An adapter that hears itself hears all requests, not those of one unit only."""
    mute = rtu(63, bytes([4, 0, 0, 0, 14]))
    lines = [f"RX: {frame.hex(' ')}" for frame in [mute] * 4 + [REQUEST, ANSWER] * 4]
    assert "hears its own transmission" not in doctor(lines, tmp_path)["sentence"]
