"""What came is almost a frame: the sentence names what would make it one, before noise."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from analyzer import SourceError, decode
from tests.doctor.frames import read_answer, read_request, rtu
from tests.doctor.test_pasted_logs import doctor
from tests.doctor.test_what_bytes_prove import pair, said

SEEDS = range(5)


def exchange(seed: int) -> tuple[bytes, bytes]:
    """A request for registers, and its answer, which has no byte that a line leaves by itself."""
    rng = Random(seed)
    unit, function, count = rng.randrange(1, 200), rng.choice((3, 4)), rng.randrange(4, 12)
    values = [rng.randrange(0x1122, 0x7744) for _ in range(count)]
    asked = rtu(unit, read_request(function, rng.randrange(0, 5000), count))
    return asked, rtu(unit, read_answer(function, values))


def ascii_frame(frame: bytes, start: str) -> bytes:
    """Serial line specification, 2.5.2: the LRC is the two's complement of the sum."""
    body = frame[:-2]
    return f"{start}{body.hex().upper()}{-sum(body) & 0xFF:02X}\r\n".encode()


@pytest.mark.parametrize("seed", SEEDS)
def test_answers_in_ascii_that_begin_with_another_sign(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    lines = pair(ascii_frame(asked, ":"), ascii_frame(answer, ">")) * 2
    sentence = said(lines, tmp_path)
    assert sentence.startswith("Nothing is wrong in these frames: all 2 requests were answered")


@pytest.mark.parametrize("seed", SEEDS)
def test_characters_are_not_compared_with_bytes(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    lines = pair(ascii_frame(asked, ":"), ascii_frame(answer, ":")[:-6]) * 2
    assert "are due" not in said(lines, tmp_path)


@pytest.mark.parametrize("stray", [0xFF, 0x00, 0x5A, 0xFE, 0x21])
def test_a_byte_too_many_is_named_with_its_place(stray: int, tmp_path: Path) -> None:
    asked, answer = exchange(stray)
    at = 4 + stray % 7
    damaged = answer[:at] + bytes([stray]) + answer[at:]
    found = doctor(pair(asked, damaged), tmp_path)
    assert f"has a byte too many ({stray:02X}, its byte {at + 1})" in found["sentence"]
    assert "bits changed on the line" not in found["sentence"]
    assert not any("no answer is in" in one["what"] for one in found["not_judged"])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_reader_that_counts_stops_before_the_last_byte(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    at = 5 + seed
    damaged = (answer[:at] + b"\xff" + answer[at:])[: len(answer)]
    assert f"has a byte too many (FF, its byte {at + 1})" in said(pair(asked, damaged), tmp_path)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_byte_too_few_is_no_changed_bit(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    damaged = answer[: 6 + seed] + answer[7 + seed :]
    sentence = said(pair(asked, damaged), tmp_path)
    assert f"{len(answer) - 1} came, and {len(answer)} are due" in sentence


@pytest.mark.parametrize(("coils", "count"), [(1, 2), (3, 2), (8, 2), (9, 3), (5, 4)])
def test_a_byte_count_that_is_too_great(coils: int, count: int, tmp_path: Path) -> None:
    """Application protocol, 6.1: one byte for eight coils."""
    due = (coils + 7) // 8
    whole = rtu(17, bytes([1, count, *range(0x41, 0x41 + count)]))
    lines = pair(rtu(17, read_request(1, 19, coils)), whole[: 5 + due])
    assert f"is {count}, and {due} is due" in said(lines, tmp_path)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_answer_after_a_run_of_idle_levels(seed: int, tmp_path: Path) -> None:
    """The byte count has a wrong bit, and one of the data has another."""
    asked, answer = exchange(seed)
    rng = Random(seed)
    front = bytes(rng.choice((0xFF, 0xFE, 0xFD, 0xFB, 0xFF)) for _ in range(9 + 4 * seed))
    damaged = bytearray(answer)
    damaged[2] ^= 2
    damaged[5] ^= 8
    lines = pair(asked, front + damaged + b"\xff\xfd\xff")
    found = doctor(lines, tmp_path)
    assert found["diagnoses"][0]["code"] == "no_bias", found["sentence"]
    assert f"({len(front)} bytes)" in found["sentence"]


def on_swapped_wires(frame: bytes) -> bytes:
    """A character of 8N1 is 0, eight bits from the lowest on, 1; swapped wires invert it."""
    levels = "".join(f"1{f'{255 - byte:08b}'[::-1]}0" for byte in frame)
    heard, at = bytearray([0]), levels.find("1")
    while (at := levels.find("0", at)) >= 0 and at + 9 < len(levels):
        heard.append(int(levels[at + 1 : at + 9][::-1], 2))
        at = at + 9 if levels[at + 9] == "1" else levels.find("1", at + 9)
        if at < 0:
            break
    return bytes(heard)


def test_levels_of_swapped_wires_by_hand() -> None:
    """01 04 BE: 0 10000000 1, 0 00100000 1, 0 01111101 1, each level inverted."""
    assert on_swapped_wires(bytes([1, 4, 0xBE, 0]))[:4].hex(" ") == "00 7f df fe"


@pytest.mark.parametrize("seed", SEEDS)
def test_an_answer_on_swapped_wires(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    found = doctor(pair(asked, on_swapped_wires(answer)), tmp_path)
    assert found["diagnoses"][0]["code"] == "swapped_wires", found["sentence"]
    assert "with its levels inverted" in found["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
def test_bytes_of_another_rate_are_not_called_inverted(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    other = Random(seed).randbytes(len(answer))
    assert "inverted" not in said(pair(asked, other), tmp_path)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_request_that_a_text_shows_without_checksum_has_no_wrong_one(
    seed: int, tmp_path: Path
) -> None:
    asked, answer = exchange(seed)
    numbers = ", ".join(f"0x{byte:02x}" for byte in asked[:-2])
    listed = ", ".join(f"{byte:02X}" for byte in answer)
    sentence = said([f"request = [{numbers}] + crc", f"Device response: [{listed}]"], tmp_path)
    assert "is wrong" not in sentence
    assert "such an answer" not in sentence


@pytest.mark.parametrize(("bits", "seed"), [(5, 1), (6, 2), (7, 3), (5, 4), (6, 5)])
def test_bytes_without_their_upper_bits(bits: int, seed: int, tmp_path: Path) -> None:
    rng = Random(seed)
    limit = (1 << bits) - 1
    log = tmp_path / "pasted.log"
    lines = []
    for unit in range(1, 7):
        frame = rtu(unit, read_answer(3, [rng.randrange(0x1000, 0x10000) for _ in range(12)]))
        lines.append("<- " + " ".join(f"0x{byte & limit:X}" for byte in frame))
    log.write_text("\n".join(lines) + "\n", "utf-8")
    with pytest.raises(SourceError, match=f"is above {limit:02X}, .* set to {bits} data bits"):
        decode(log).doctor()
