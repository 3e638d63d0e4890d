"""What an answer lacks, or has changed throughout, is named, and only what its bytes show."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.doctor.frames import crc, mbap, read_answer, read_request, rtu
from tests.doctor.test_almost_frames import SEEDS, ascii_frame, exchange
from tests.doctor.test_first_words import refused
from tests.doctor.test_what_bytes_prove import pair, said


@pytest.mark.parametrize("seed", SEEDS)
def test_an_answer_without_its_checksum(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    sentence = said([*pair(asked, answer[:-2]), "CRC check failed"], tmp_path)
    assert "is whole but for the two bytes of its checksum" in sentence


@pytest.mark.parametrize("values", [[0x81F2, 0x00FE, 0xE07F], [0xF00D], [0x9234, 0x0056]])
def test_an_answer_without_its_highest_bits(values: list[int], tmp_path: Path) -> None:
    asked = rtu(9, read_request(3, 300, len(values)))
    low = bytes(byte & 0x7F for byte in rtu(9, read_answer(3, values)))
    assert "the highest bit of each byte is missing" in said(pair(asked, low), tmp_path)


@pytest.mark.parametrize("seed", SEEDS)
def test_low_bytes_that_no_highest_bit_makes_right_are_noise(seed: int, tmp_path: Path) -> None:
    """None of the 256 answers that four registers may have had has this checksum."""
    body = bytes([9, 3, 8, *(seed + 3 * at for at in range(8))])
    raised = (
        bytes(byte | 0x80 * (at >= 3 and chosen >> (at - 3) & 1) for at, byte in enumerate(body))
        for chosen in range(256)
    )
    taken = {crc(one) & 0x7F7F for one in raised}
    free = next(number for number in range(0x1234, 0x7F7F) if number & 0x7F7F not in taken)
    low = body + bytes([free & 0x7F, free >> 8 & 0x7F])
    sentence = said(pair(rtu(9, read_request(3, 0, 4)), low), tmp_path)
    assert "highest bit" not in sentence


@pytest.mark.parametrize("is_odd", [0, 1])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_parity_bit_in_place_of_the_highest_one(seed: int, is_odd: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    low = [byte & 0x7F for byte in answer]
    heard = bytes(byte | 0x80 * ((byte.bit_count() + is_odd) % 2) for byte in low)
    assert "is the parity of the other seven" in said(pair(asked, heard), tmp_path)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_wrong_checksum_in_ascii_is_named_with_the_right_one(seed: int, tmp_path: Path) -> None:
    """Serial line specification, 2.5.2.2: the two's complement of the sum of the bytes."""
    asked, answer = exchange(seed)
    right = -sum(answer[:-2]) & 0xFF
    wrong = right ^ (1 + seed)
    damaged = ascii_frame(answer, ":")[:-4] + f"{wrong:02X}\r\n".encode()
    lines = [f"TX {ascii_frame(asked, ':').decode().strip()}", f"RX {damaged.decode().strip()}"]
    sentence = said([*lines, "LRC error"], tmp_path)
    assert f"({wrong:02X}, and {right:02X} belongs to these characters)" in sentence


@pytest.mark.parametrize("count", [1, 3, 5, 7])
def test_an_odd_number_of_bytes_for_registers(count: int, tmp_path: Path) -> None:
    answer = rtu(1, bytes([3, count, *range(1, count + 1)]))
    sentence = said([f"RX: {answer.hex(' ')}", "index out of range"], tmp_path)
    assert f"is odd ({count}), and its checksum is right" in sentence


@pytest.mark.parametrize("number", [1, 2, 300])
def test_an_identifier_with_its_bytes_swapped(number: int, tmp_path: Path) -> None:
    swapped = int.from_bytes(number.to_bytes(2, "little"), "big")
    asked = mbap(number, 1, read_request(3, 10, 2))
    sentence = said(pair(asked, mbap(swapped, 1, read_answer(3, [4, 5]))), tmp_path)
    assert f"bytes swapped ({swapped}, and {number} was sent)" in sentence


def test_an_identifier_of_nothing_is_named(tmp_path: Path) -> None:
    asked = mbap(9, 1, read_request(3, 10, 2))
    sentence = said(pair(asked, mbap(0, 1, read_answer(3, [4, 5]))), tmp_path)
    assert "is not that of the request (0, and 9 was sent)" in sentence


@pytest.mark.parametrize("count", [2, 3, 6, 9])
def test_a_length_field_that_is_too_small(count: int, tmp_path: Path) -> None:
    """Messaging on TCP/IP, 3.1.3: it counts the unit and the PDU; 6 is right for requests only."""
    whole = mbap(1, 1, read_answer(3, list(range(7, 7 + count))))
    answer = whole[:5] + bytes([6]) + whole[6:]
    sentence = said(pair(mbap(1, 1, read_request(3, 0, count)), answer), tmp_path)
    assert "length field" in sentence
    assert "a quantity of" not in sentence
    assert count > 3 or f"announces 6 bytes, and {3 + 2 * count} follow" in sentence


@pytest.mark.parametrize("extra", ["3c", "21", "ab", "5a e1"])
@pytest.mark.parametrize("is_in_front", [True, False])
def test_bytes_beside_a_whole_answer(extra: str, is_in_front: bool, tmp_path: Path) -> None:
    """Such bytes are no levels, and the program that checks all of them is not wrong."""
    _, answer = exchange(2)
    shown = f"{extra} {answer.hex(' ')}" if is_in_front else f"{answer.hex(' ')} {extra}"
    sentence = said([f"RX: {shown}", "CRC error"], tmp_path)
    assert "stand before or after whole frames" in sentence
    assert "checks them wrongly" not in sentence


@pytest.mark.parametrize("code", [1, 2, 3, 4])
def test_a_refusal_with_a_wrong_checksum(code: int, tmp_path: Path) -> None:
    asked = rtu(5, read_request(4, 0, 2))
    sentence = said(pair(asked, bytes([5, 0x84, code, 0x11, 0x11])), tmp_path)
    assert f"Unit 5 refuses (exception {code}), and the checksum" in sentence


@pytest.mark.parametrize(("function", "code"), [(3, 2), (4, 2), (1, 1), (16, 3)])
def test_a_refusal_of_two_bytes(function: int, code: int, tmp_path: Path) -> None:
    asked = read_request(function, 16, 2) if function < 16 else bytes([16, 0, 1, 0, 1, 2, 0, 5])
    lines = [f"request pdu {asked.hex(' ')}", f"response pdu {function + 128:02x} {code:02x}"]
    assert f"function {function} is refused with exception {code} (" in refused(lines, tmp_path)


def test_a_frame_is_whole_and_the_program_complains(tmp_path: Path) -> None:
    frame = rtu(3, bytes([5, 0, 0, 0xFF, 0]))
    received = f"received <Buffer {frame.hex(' ')}>"
    complaint = "CRC does not match 55437 !== 10444"
    made = "create crc from response <Buffer 03 05 00 00 00 00>"
    for lines in ([received, complaint], [received, made, complaint]):
        assert "have right ones" in said(lines, tmp_path)
