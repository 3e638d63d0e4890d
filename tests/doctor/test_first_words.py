"""What the doctor says first of a few frames: what they hold, and what words beside them mean."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from analyzer import SourceError, decode
from tests.doctor.frames import crc, read_answer, read_request, rtu
from tests.doctor.test_pasted_logs import mbap
from tests.doctor.test_what_bytes_prove import pair, said

ASKED = rtu(7, read_request(3, 100, 2))
WHOLE = rtu(7, read_answer(3, [10, 20]))


def refused(lines: list[str], folder: Path) -> str:
    """Why a text without any proven frame is not read."""
    log = folder / "paste.txt"
    log.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    with pytest.raises(SourceError) as error:
        decode(log).doctor()
    return str(error.value)


def test_what_whole_frames_hold_is_said(tmp_path: Path) -> None:
    sentence = said(pair(ASKED, WHOLE), tmp_path)
    told = "unit 7 answers the read of holding registers 100 to 101 (function 3) with 10 and 20"
    assert f"Nothing is wrong in these frames: 1 request was answered: {told}" in sentence


@pytest.mark.parametrize(("value", "number"), [(230.5, "230.5"), (-12.25, "-12.25"), (50.0, "50")])
def test_a_float_is_named_in_the_order_in_which_it_makes_sense(
    value: float, number: str, tmp_path: Path
) -> None:
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    right, swapped = (rtu(7, read_answer(3, words)) for words in ([high, low], [low, high]))
    assert f"(as a float: {number})" in said(pair(ASKED, right), tmp_path)
    assert f"low word first: {number})" in said(pair(ASKED, swapped), tmp_path)


def test_a_frame_alone_is_said(tmp_path: Path) -> None:
    asked = said([f"sent {ASKED.hex(' ')}"], tmp_path)
    assert "a request to unit 7: the read of holding registers 100 to 101" in asked
    answered = said([f"got {WHOLE.hex(' ')}"], tmp_path)
    assert "an answer of unit 7: 2 holding registers: 10 and 20 (function 3)" in answered
    for sentence in (asked, answered):
        assert sentence.startswith("Nothing is wrong in this frame")


@pytest.mark.parametrize(("function", "value"), [(6, 0), (6, 0x1234), (5, 0xFF00)])
@pytest.mark.parametrize("is_tcp", [False, True])
def test_the_value_of_a_write_alone_is_said(
    function: int, value: int, is_tcp: bool, tmp_path: Path
) -> None:
    """Application protocol, 6.5 and 6.6: address and value; the answer repeats both."""
    asked = struct.pack(">BHH", function, 40, value)
    frame = mbap(9, 3, asked) if is_tcp else rtu(3, asked)
    sentence = said([f"sent {frame.hex(' ')}"], tmp_path)
    assert f"40 (function {function}) with {value} (hex {value:04X}), or its confirm" in sentence


@pytest.mark.parametrize(
    ("function", "quantity", "most"),
    [(3, 0, 125), (3, 126, 125), (4, 200, 125), (1, 2001, 2000), (2, 4000, 2000)],
)
def test_a_quantity_that_no_function_allows_is_named(
    function: int, quantity: int, most: int, tmp_path: Path
) -> None:
    """Application protocol, 6.1 to 6.4: 1 to 2000 coils or inputs, 1 to 125 registers."""
    frame = rtu(1, read_request(function, 0, quantity))
    sentence = said([f"TX: {frame.hex(' ')}", "timeout"], tmp_path)
    assert f"asks for a quantity of {quantity}, and its function allows 1 to {most}" in sentence


def test_the_value_of_a_coil_is_checked(tmp_path: Path) -> None:
    """Application protocol, 6.5: FF 00 or 00 00."""
    frame = rtu(1, bytes([5, 0, 10, 0, 1]))
    assert "other than FF00" in said([f"TX: {frame.hex(' ')}"], tmp_path)


@pytest.mark.parametrize("length", [12, 17, 30, 41])
def test_a_cut_answer_alone_says_so_whatever_the_words(length: int, tmp_path: Path) -> None:
    whole = rtu(3, read_answer(3, [at * 4099 % 65536 for at in range(20)]))
    reason = refused([f"response: {whole[:length].hex(' ')}", "CRC error"], tmp_path)
    assert f"40 bytes of data, and {length - 3} of 42 bytes are there" in reason


def _looks_like_one_wrong_bit(frame: bytes) -> bool:
    return any(
        crc(changed[:-2]).to_bytes(2, "little") == changed[-2:]
        for at in range(8 * len(frame))
        for changed in [
            bytes(
                byte ^ (1 << at % 8 if place == at // 8 else 0) for place, byte in enumerate(frame)
            )
        ]
    )


def test_a_cut_answer_is_no_wrong_bit(tmp_path: Path) -> None:
    """A part of an answer that one bit would make right by chance has the wrong length for it."""
    asked = rtu(3, read_request(3, 0, 20))
    found = 0
    for seed in range(3000):
        values = [(seed * 40503 + at * 30011) % 65536 for at in range(20)]
        whole = rtu(3, read_answer(3, values))
        cut = whole[: 12 + seed % 20]
        if found == 5 or not _looks_like_one_wrong_bit(cut):
            continue
        found += 1
        sentence = said(pair(asked, cut), tmp_path)
        assert f"({len(cut)} bytes are there, and 45 are due)" in sentence
        assert "One bit" not in sentence
    assert found == 5


@pytest.mark.parametrize("words", ["CRC error", "Checksum mismatch!", "invalid CRC"])
def test_words_of_a_wrong_checksum_beside_a_right_request(words: str, tmp_path: Path) -> None:
    sentence = said([f"RX: {ASKED.hex(' ')}", words], tmp_path)
    assert "a wrong checksum, and the request that is printed here has a right one" in sentence


@pytest.mark.parametrize("words", ["Request timed out", "no response received", "timeout!"])
def test_words_of_a_timeout_beside_its_answer(words: str, tmp_path: Path) -> None:
    for lines in ([*pair(ASKED, WHOLE), words], [words, f"received {WHOLE.hex(' ')}"]):
        sentence = said(lines, tmp_path)
        assert "the answer came when the program had given up" in sentence
        assert "wires" not in sentence


def test_an_answer_after_the_next_request_is_late(tmp_path: Path) -> None:
    one, other = (mbap(number, 7, read_request(3, 16 * number, 2)) for number in (5, 6))
    late = mbap(5, 7, read_answer(3, [1, 2]))
    lines = [f"TX {one.hex(' ')}", "timeout", f"TX {other.hex(' ')}", f"RX {late.hex(' ')}"]
    assert "The answer belongs to the request before" in said(lines, tmp_path)


def test_a_request_after_an_answer_without_one_is_not_to_a_mute_unit(tmp_path: Path) -> None:
    asked = [rtu(7, read_request(4, 16, 2)), rtu(7, read_request(4, 32, 2))]
    lines = [f"RX {WHOLE.hex(' ')}", *(f"TX {one.hex(' ')}" for one in asked)]
    assert "No answer of unit 7" not in said(lines, tmp_path)


def test_a_confirmation_of_another_value_names_both(tmp_path: Path) -> None:
    asked, answer = (rtu(1, bytes([6, 0, 16, 0, value])) for value in (100, 3))
    assert "(3, and 100 was asked for)" in said(pair(asked, answer), tmp_path)


def test_another_function_is_named(tmp_path: Path) -> None:
    answer = rtu(7, read_answer(4, [10, 20]))
    assert "(4, and 3 was asked for)" in said(pair(ASKED, answer), tmp_path)


@pytest.mark.parametrize(
    ("bytes_of", "says"),
    [
        ("03 00 00 00 02", "the read of holding registers 0 to 1 (function 3)"),
        ("04 0A 00 01 00 02 00 03 00 04 00 05", "5 input registers: 1, 2 and 3 more (function 4)"),
        ("06 00 01 00 64", "the write of holding register 1 (function 6)"),
        ("10 00 01 00 02", "the write of holding registers 1 to 2 (function 16)"),
        ("01 00 13 00 25", "the read of coils 19 to 55 (function 1)"),
    ],
)
def test_a_pdu_alone_is_read_as_such(bytes_of: str, says: str, tmp_path: Path) -> None:
    reason = refused([f"frame: {bytes_of}"], tmp_path)
    assert (
        f"are a frame without unit and checksum, as programs print it, and whole as such: {says}"
        in reason
    )


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("ModbusMaster result: 0xE2", "of ModbusMaster that no answer came in time"),
        ("error 224", "of eModbus and esp32ModbusRTU that no answer came in time"),
        ("Request result: 0xE4", "of modbus-esp8266 that no answer came in time"),
        ("Data length error, expected 9 got 7", "an answer of 7 bytes in place of 9"),
        ("Expected 12 bytes, received 5 bytes", "an answer of 5 bytes in place of 12"),
        ("response data size '5' does not match count '4'", "an answer of 5 bytes in place of 4"),
        ("Invalid transaction ID received 0x5 (not 0x6)", "another transaction identifier"),
        ("serial: could not open port 'COM3'", "a port that the program cannot open"),
        ("PortNotOpenError: Port Not Open", "a port that the program cannot open"),
        ("read tcp: connection reset by peer", "a connection that the other side closed"),
        ("modbus: read failed: unexpected EOF", "a connection that the other side closed"),
        ("client: retry because of EOF", "a connection that the other side closed"),
    ],
)
def test_words_of_programs_are_explained(line: str, says: str, tmp_path: Path) -> None:
    assert says in refused([line], tmp_path)


def test_a_frame_of_another_protocol_is_named(tmp_path: Path) -> None:
    """DL/T 645: 68, address, 68, control, length, data, the sum of all of these, 16."""
    frame = bytes.fromhex("68 12 34 56 78 90 12 68 91 04 33 33 34 33")
    frame += bytes([sum(frame) & 0xFF, 0x16])
    assert "a frame of another protocol: DL/T 645" in said(pair(ASKED, frame), tmp_path)


def test_a_missing_header_is_named(tmp_path: Path) -> None:
    answer = mbap(1, 1, read_answer(3, [1, 2]))
    lines = [f"Tx: {bytes([1, *read_request(3, 0, 2)]).hex(' ')}", f"Rx: {answer.hex(' ')}"]
    assert "no MBAP header" in said(lines, tmp_path)


@pytest.mark.parametrize(("count", "values"), [(5, [1, 2]), (2, [1, 2]), (8, [1, 2, 3])])
def test_a_wrong_byte_count_of_an_answer_alone_is_named(
    count: int, values: list[int], tmp_path: Path
) -> None:
    answer = bytearray(read_answer(3, values))
    answer[1] = count
    sentence = said([f"Rx: {rtu(1, bytes(answer)).hex(' ')}"], tmp_path)
    assert f"(it says {count}, and {2 * len(values)} follow)" in sentence


@pytest.mark.parametrize("unit", [3, 4])
def test_bytes_without_checksum_or_without_unit_may_be_either(unit: int, tmp_path: Path) -> None:
    """A request of this unit, or two input registers of any."""
    reason = refused([f"frame: {unit:02x} 04 00 0a 00 02"], tmp_path)
    assert (
        f"a frame of unit {unit} without its checksum, the read of input registers 10 to 11"
        in reason
    )
    kind = {3: "holding", 4: "input"}[unit]
    assert f"or its unit is left out as well: 2 {kind} registers: 10 and 2" in reason
