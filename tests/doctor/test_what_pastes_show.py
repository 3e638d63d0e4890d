"""Bytes beside whole frames do not hide what failed, and are placed where they were."""

from __future__ import annotations

from pathlib import Path

from tests.doctor.frames import read_answer, read_request, rtu
from tests.doctor.test_pasted_logs import codes, doctor, mbap

# Unit 20 is asked for three input registers from 32 on.
ASKED = rtu(20, read_request(4, 32, 3))
WHOLE = rtu(20, bytes([4, 6, 0, 9, 2, 0x58, 1, 3]))


def exchange(answer: bytes) -> list[str]:
    return [f"TX: {ASKED.hex(' ')}", f"RX: {answer.hex(' ')}"]


def test_arrays_hold_decimal_numbers(tmp_path: Path) -> None:
    """JSON has no hex: registers 20 and 21 hold 31 and 8 (RFC 8259, 6)."""
    asked, answer = mbap(3, 2, read_request(3, 20, 2)), mbap(3, 2, bytes([3, 4, 0, 31, 0, 8]))
    lines = [f"[{','.join(map(str, frame))}]" for frame in (asked, answer)]
    assert "holding registers 20 to 21 (function 3) with 31 and 8" in str(
        doctor(lines, tmp_path)["sentence"]
    )


def test_a_byte_after_a_damaged_answer_is_not_before_it(tmp_path: Path) -> None:
    """The last byte of the checksum became FF."""
    found = doctor(exchange(WHOLE[:-1] + b"\xff"), tmp_path)
    assert f"(FF, and {WHOLE[-1]:02X} belongs there)" in found["sentence"]
    assert "before the answer" not in " ".join(row["sentence"] for row in found["diagnoses"])


def test_a_byte_between_the_halves_of_a_checksum_is_one_too_many(tmp_path: Path) -> None:
    found = doctor(exchange(WHOLE[:-1] + b"\xff" + WHOLE[-1:]), tmp_path)
    assert "has a byte too many (FF, its byte 11)" in found["sentence"]


def test_a_byte_before_a_checksum_whose_end_was_not_read_is_one_too_many(tmp_path: Path) -> None:
    """The client reads as many bytes as it expects."""
    found = doctor(exchange(WHOLE[:-2] + b"\x00" + WHOLE[-2:-1]), tmp_path)
    assert "has a byte too many (00, its byte 10)" in found["sentence"]


def test_a_damaged_answer_comes_before_strays(tmp_path: Path) -> None:
    damaged = bytes(byte ^ (0x20 if at == 4 else 0) for at, byte in enumerate(WHOLE))
    lines = [line for _ in range(4) for line in exchange(WHOLE + b"\x00")]
    found = doctor([*lines, *exchange(damaged)], tmp_path)
    assert "One bit of the answer is wrong" in found["sentence"]
    assert codes(found) == ["line_noise", "no_bias"]


def test_a_byte_of_an_idle_line_is_no_answer(tmp_path: Path) -> None:
    found = doctor(exchange(b"\x00") * 3, tmp_path)
    assert "No answer of unit 20 is in the recording" in found["sentence"]
    words = " ".join(row["sentence"] for row in found["diagnoses"])
    assert "before answers" not in words
    assert "3 of them after a request without an answer" in words


def test_an_answer_whose_request_is_not_there_makes_no_bystander(tmp_path: Path) -> None:
    """Another function than was asked for, after the request was answered."""
    alone = rtu(33, read_answer(3, [1, 2, 3, 4]))
    found = doctor([*exchange(WHOLE), f"RX: {alone.hex(' ')}"], tmp_path)
    assert codes(found) == ["two_masters"]
    assert "An answer of unit 33 came that is none to the last request" in found["sentence"]
    assert "the text leaves its request out" in found["sentence"]


def test_alternate_answers_without_the_requests_of_one_accuse_nobody(tmp_path: Path) -> None:
    other = rtu(33, WHOLE[1:-2])
    found = doctor([*exchange(WHOLE), f"RX: {other.hex(' ')}"] * 3, tmp_path)
    assert "too: " not in found["sentence"]
    assert "the text leaves its request out" in found["sentence"]


def test_who_answers_with_another_number_comes_before_who_does_not(tmp_path: Path) -> None:
    found = doctor(exchange(rtu(33, WHOLE[1:-2])) * 3, tmp_path)
    assert "Unit 33 answers, and unit 20 was asked" in found["sentence"]
    assert "No answer" not in " ".join(row["sentence"] for row in found["diagnoses"])


def test_what_was_sent_twice_is_no_answer(tmp_path: Path) -> None:
    """The second print stops before its end."""
    sent = [f"Sending: {ASKED.hex(' ')}", f"Sending: {ASKED[:5].hex(' ')}"]
    found = doctor(sent, tmp_path)
    said = found["sentence"] + " ".join(row["sentence"] for row in found["diagnoses"])
    assert "he answer of unit 20" not in said
    answered = doctor([*exchange(WHOLE), f"TX: {ASKED[:5].hex(' ')}", *exchange(WHOLE)], tmp_path)
    assert "A request to unit 20 stops before its end (5 bytes" in answered["sentence"]
