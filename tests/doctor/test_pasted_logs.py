"""Logs as people paste them into a question: a few lines, bytes that a client has cut."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from analyzer import decode
from tests.doctor.frames import read_request, rtu

REQUEST = rtu(7, read_request(3, 24, 4))
ANSWER = rtu(7, bytes([3, 8, 0, 0, 1, 44, 0, 20, 83, 240]))


def doctor(lines: list[str], folder: Path) -> dict[str, object]:
    log = folder / "pasted.log"
    log.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    return decode(log).doctor()


def codes(found: dict[str, object]) -> list[str]:
    rows = found["diagnoses"]
    assert isinstance(rows, list)
    return [row["code"] for row in rows]


def cut_answers(stray: bytes) -> list[str]:
    """A client reads as many bytes as it expects: one in front, and the last is missing."""
    return [f"TX: {REQUEST.hex(' ')}", f"RX: {(stray + ANSWER)[: len(ANSWER)].hex(' ')}"] * 12


def test_a_stray_byte_that_pushes_the_last_one_out_is_no_wrong_rate(tmp_path: Path) -> None:
    found = doctor(cut_answers(b"\x00"), tmp_path)
    assert codes(found) == ["no_bias"], found["sentence"]


def test_bytes_without_unit_and_function_may_be_of_another_rate(tmp_path: Path) -> None:
    """The near miss: as many bytes, none of which looks like an answer."""
    rng = Random(5)
    garbled = [bytes(rng.choice(range(0x20, 0xE0)) for _ in ANSWER) for _ in range(12)]
    lines = [line for bad in garbled for line in (f"TX: {REQUEST.hex(' ')}", f"RX: {bad.hex(' ')}")]
    assert "wrong_line_settings" in codes(doctor(lines, tmp_path))


def overheard() -> list[str]:
    """A client asks unit 1, which is not there, and hears what unit 2 answers to another master."""
    rng = Random(3)
    asked, lines = rtu(1, read_request(3, 0, 10)), []
    for number in range(20):
        lines.append(f"10:{number:02}:00.100 Tx: {asked.hex(' ')}")
        if number % 2 == 0:
            other = rtu(2, bytes([3, 40, *rng.randbytes(40)]))
            lines.append(f"10:{number:02}:00.300 Rx: {other.hex(' ')}")
    return lines


def test_answers_to_another_master_are_not_those_of_a_bystander(tmp_path: Path) -> None:
    assert "bystander" not in codes(doctor(overheard(), tmp_path))


def test_answers_of_the_length_asked_for_are_those_of_a_bystander(tmp_path: Path) -> None:
    asked = rtu(2, bytes([3, 20, *range(20)])).hex(" ")
    lines = [line if "Tx" in line else f"{line[:12]} Rx: {asked}" for line in overheard()]
    assert "bystander" in codes(doctor(lines, tmp_path))


def esphome(second: int, request: bytes, answer: bytes | None) -> list[str]:
    """What ESPHome prints with `debug:` of its uart and VERBOSE: each request twice."""
    at = f"[12:30:{second:02}]"
    lines = [
        f"{at}[V][modbus:222]: Modbus write: {request.hex('.').upper()} ({len(request)})",
        f"{at}[D][uart_debug:114]: >>> {request.hex(':').upper()}",
    ]
    return (
        lines
        if answer is None
        else [*lines, f"{at}[D][uart_debug:114]: <<< {answer.hex(':').upper()}"]
    )


def test_what_two_parts_of_a_program_print_of_one_request_is_one_request(tmp_path: Path) -> None:
    """Also where it is sent again without an answer between."""
    log = tmp_path / "esphome.log"
    lines = [
        line
        for second in range(0, 24, 2)
        for line in esphome(second, REQUEST, None if second % 6 else ANSWER)
    ]
    log.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    order = [REQUEST, ANSWER, REQUEST, REQUEST] * 4
    assert [frame.hex for frame in decode(log).frames] == order


def test_damaged_answers_that_one_part_of_a_program_prints_are_read(tmp_path: Path) -> None:
    """The request is printed twice and counted once; what came as its answer is printed once."""
    log = tmp_path / "esphome.log"
    lines = [
        line
        for second in range(12)
        for line in esphome(second, REQUEST, bytes.fromhex("F5F3D39AFEF9B9A5"))
    ]
    log.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    frames = list(decode(log).frames)
    assert sum(frame.hex == REQUEST for frame in frames) == 12
    assert sum(frame.byte_length for frame in frames if frame.hex != REQUEST) == 12 * 8


@pytest.mark.parametrize(
    ("answers", "says"),
    [
        ([ANSWER], "1 request is too few."),
        ([ANSWER[:-1] + b"\x5a"] * 2, "2 requests are too few; 2 of 2 failed."),
        ([rtu(7, b"\x83\x02"), ANSWER], "2 requests are too few; 1 was refused by an exception."),
    ],
)
def test_a_few_requests_are_no_ground_for_a_verdict_but_were_read(
    answers: list[bytes], says: str, tmp_path: Path
) -> None:
    lines = [
        line for answer in answers for line in (f"TX: {REQUEST.hex(' ')}", f"RX: {answer.hex(' ')}")
    ]
    assert doctor(lines, tmp_path)["sentence"] == f"This recording cannot be judged: {says}"


def test_a_floating_line_is_not_the_cause_of_exceptions(tmp_path: Path) -> None:
    refused = rtu(7, b"\x83\x02")
    found = doctor([f"TX: {REQUEST.hex(' ')}", f"RX: 00 {refused.hex(' ')} 00"] * 12, tmp_path)
    assert "no_bias" in codes(found)
    assert "The cause: The line floats" not in str(found["sentence"])
