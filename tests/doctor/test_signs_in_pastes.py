"""What a few pasted frames show beside one another: refusals, lists, idle and inverted levels."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.doctor.frames import exception, mbap, read_answer, read_request, rtu
from tests.doctor.test_almost_frames import SEEDS, exchange
from tests.doctor.test_first_words import refused
from tests.doctor.test_pasted_logs import codes, doctor
from tests.doctor.test_what_bytes_prove import pair, said

# Unit 17 is asked for three holding registers from 107 on (application protocol, 6.3).
ASKED = rtu(17, read_request(3, 107, 3))


def inverted(frame: bytes, *, even: bool = False) -> bytes:
    """What a receiver on swapped wires makes of a frame: each one begins a character."""
    bits: list[int] = []
    for byte in frame:
        bits += [0, *(byte >> place & 1 for place in range(8)), *([byte.bit_count() % 2] * even), 1]
    made, at, length = bytearray(), 0, 10 + even
    while at + 9 <= len(bits):
        if not bits[at]:
            at += 1
            continue
        made.append(sum((1 - bits[at + 1 + place]) << place for place in range(8)))
        at += length - 1
        while at < len(bits) and bits[at]:
            at += 1
    return bytes(made)


@pytest.mark.parametrize("function", [1, 2, 3, 4])
@pytest.mark.parametrize("length", [2, 4])
def test_a_refusal_whose_rest_was_not_read(function: int, length: int, tmp_path: Path) -> None:
    """Application protocol, 7: the function with its highest bit set."""
    answer = rtu(44, exception(function, 2))[:length]
    sentence = said(pair(rtu(44, read_request(function, 900, 1)), answer), tmp_path)
    assert f"Unit 44 refuses function {function}" in sentence
    assert f"{length} of 5 bytes are there" in sentence
    assert "not with its function" not in sentence


def test_another_second_byte_is_no_refusal(tmp_path: Path) -> None:
    sentence = said(pair(ASKED, bytes([17, 0x9D])), tmp_path)
    assert "refuses" not in sentence


@pytest.mark.parametrize("count", [1, 2, 6])
def test_answers_after_one_request_are_a_list(count: int, tmp_path: Path) -> None:
    """Three registers were asked for, and each answer has as many as the parameter says."""
    answers = [rtu(17, read_answer(3, [300 + at] * count)).hex(" ") for at in range(4)]
    found = doctor([f"I send {ASKED.hex(' ')}", "and this is what I see:", *answers], tmp_path)
    assert codes(found) == ["wrong_layout"]
    assert f"({2 * count} bytes of data, and 6 were due)" in found["sentence"]


def test_a_list_of_right_answers_is_no_second_unit(tmp_path: Path) -> None:
    answers = [rtu(17, read_answer(3, [at, 7, at])).hex(" ") for at in range(5)]
    found = doctor([f"I send {ASKED.hex(' ')}", "and this is what I see:", *answers], tmp_path)
    assert codes(found) == []
    assert "1 request comes before 5 answers to it" in found["sentence"]
    assert "each of them fits it" in found["sentence"]


def test_two_answers_are_no_list(tmp_path: Path) -> None:
    answers = [rtu(17, read_answer(3, [at, 7, at])).hex(" ") for at in (4, 9)]
    assert "A second valid answer came" in said([ASKED.hex(" "), *answers], tmp_path)


@pytest.mark.parametrize("idle", [b"\x00" * 5, b"\xff" * 11, b"\x00\xf8\x00\xfe"])
def test_idle_bytes_in_front_of_a_request_are_no_answer(idle: bytes, tmp_path: Path) -> None:
    lines = [ASKED.hex(" "), ASKED.hex(" "), (idle + ASKED).hex(" ")]
    found = doctor([*lines, "that last one is odd"], tmp_path)
    assert codes(found) == ["no_bias"]
    assert f"({len(idle)}: {idle[0]:02X} and their like)" in found["sentence"]


def test_idle_bytes_in_a_line_of_their_own_may_be_an_answer(tmp_path: Path) -> None:
    found = doctor([*pair(ASKED, b"\x00" * 6), f"TX: {ASKED.hex(' ')}"], tmp_path)
    assert codes(found) == ["swapped_wires"]


def test_levels_beside_whole_answers_are_no_swapped_wires(tmp_path: Path) -> None:
    whole = rtu(17, read_answer(3, [1, 2, 3]))
    found = doctor([*pair(ASKED, whole), *pair(ASKED, b"\x00\x00\xfe\x00\x00")], tmp_path)
    assert codes(found) == ["no_bias"]
    assert "other answers of it are whole" in found["sentence"]


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_request_itself_on_swapped_wires(seed: int, even: bool, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    sentence = said(pair(asked, inverted(asked, even=even)), tmp_path)
    assert "is the request itself with its levels inverted" in sentence
    sentence = said(pair(asked, inverted(answer, even=even)), tmp_path)
    assert "is the beginning of the answer" in sentence


@pytest.mark.parametrize("code", [1, 2, 3, 4])
def test_a_refusal_alone_lacks_its_checksum(code: int, tmp_path: Path) -> None:
    found = doctor(pair(ASKED, bytes([17]) + exception(3, code)), tmp_path)
    assert codes(found) == ["wrong_layout"]
    assert f"refuses without a checksum (exception {code}, " in found["sentence"]


def test_a_text_without_checksums_accuses_no_unit(tmp_path: Path) -> None:
    answered = pair(ASKED, rtu(17, read_answer(3, [1, 2, 3]))[:-2])
    found = doctor([*answered, *pair(ASKED, bytes([17, 0x83, 2]))], tmp_path)
    assert "is whole but for the two bytes of its checksum" in found["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_request_in_front_of_its_answer_may_be_an_echo(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    sentence = said([f"Response I get: {asked.hex(' ')} {answer.hex(' ')}"], tmp_path)
    assert sentence.startswith("What was received is a request and, right after it, its answer")
    assert "own_echo" in sentence
    apart = said([f"RX: {asked.hex(' ')}", f"RX: {answer.hex(' ')}"], tmp_path)
    assert apart.startswith("Nothing is wrong in these frames")


def test_bytes_of_no_frame_are_shown(tmp_path: Path) -> None:
    odd = bytes([0x84, 0x21, 0x9C, 0x63, 0x1D, 0xB7, 0x0A, 0x5E, 0x48, 0x32, 0x71])
    whole = rtu(17, read_answer(3, [20, 21, 22]))
    sentence = said([*pair(ASKED, whole), f"RX: {odd.hex(' ')}"], tmp_path)
    assert f"are of no valid frame ({odd.hex(' ').upper()})" in sentence
    assert "as many as the answer before has" in sentence


@pytest.mark.parametrize("width", [7, 10, 16])
@pytest.mark.parametrize("is_tcp", [False, True])
def test_a_frame_that_is_wrapped_over_several_lines(
    width: int, is_tcp: bool, tmp_path: Path
) -> None:
    asked = mbap(6, 9, read_request(4, 60, 30)) if is_tcp else rtu(9, read_request(4, 60, 30))
    answer = rtu(9, read_answer(4, [0x0102 + 77 * at for at in range(30)]))
    parts = [answer[at : at + width].hex(" ") for at in range(0, len(answer), width)]
    lines = [f"Sent: {asked.hex(' ')}", f"Received: {parts[0]}", *parts[1:], "What is wrong?"]
    found = doctor(lines, tmp_path)
    assert codes(found) == (["framing_mismatch"] if is_tcp else [])
    assert is_tcp or "input registers 60 to 89" in found["sentence"]


@pytest.mark.parametrize("mark", ["**", "__", "`", ""])
def test_a_0x_in_front_of_the_first_of_several_words(mark: str, tmp_path: Path) -> None:
    frame = rtu(23, read_answer(3, [0, 0x4120])).hex().upper()
    shown = f"0x{frame[:6]} {mark}{frame[6:14]}{mark} {frame[14:]}"
    sentence = said([f"In the reply, which is {shown}, I see ten."], tmp_path)
    assert sentence.startswith("Nothing is wrong in this frame: it is an answer of unit 23")


def test_bytes_after_a_name_without_leading_zeros(tmp_path: Path) -> None:
    lines = ["What I get:", *["level is: A7 3 FE 9 D1 2 C6 -> 812 mm"] * 4]
    message = refused(lines, tmp_path)
    assert "a7 03 fe 09 d1 02 c6 are no frame, and come so again and again" in message


def test_numbers_after_a_name_are_no_bytes(tmp_path: Path) -> None:
    message = refused(["What I get:", *["levels: 17 3 25 9 81 2 46 -> 812 mm"] * 4], tmp_path)
    assert "are no frame" not in message


PROGRAM = [
    "unsigned char ask[] = { 0x11, 0x03, 0x00, 0x6B, 0x00, 0x03 };",
    "uint16_t sum = crc16(ask, sizeof ask);",
    "append(ask, sum);",
]


def test_a_program_that_adds_the_checksum_lacks_none(tmp_path: Path) -> None:
    answer = f"// got {rtu(17, read_answer(3, [1, 2, 3])).hex(' ')}"
    sentence = said([*PROGRAM, answer], tmp_path)
    assert sentence.startswith("Nothing is wrong in this frame: it is an answer of unit 17")
    assert "could not be read" not in sentence
    assert "without its checksum" in said([PROGRAM[0], "send(ask);", answer], tmp_path)


def test_a_long_frame_in_a_wrapper_proves_the_line(tmp_path: Path) -> None:
    """A logger puts two bytes of its own in front of the answer, and prints no request."""
    answer = rtu(0x61, bytes([3, 60]) + bytes(range(60)))
    line = f"received: {(bytes([0xAA, 0x55]) + answer).hex()}"
    assert "wrong_line_settings" not in codes(doctor([line], tmp_path))
