"""What concerns a whole line is one cause, and not one of each unit or block.

The recordings are raw bytes without times, so that nothing but the frames can tell.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from analyzer import decode
from tests.doctor.frames import exception, read_answer, read_request, rtu

ROUNDS = 40


def judged(frames: Iterator[bytes], folder: Path) -> tuple[str, list[dict[str, Any]]]:
    path = folder / "line.bin"
    path.write_bytes(b"".join(frames))
    document = decode(path).doctor()
    return document["sentence"], document["diagnoses"]


def exchange(unit: int, address: int, values: list[int]) -> bytes:
    return rtu(unit, read_request(3, address, len(values))) + rtu(unit, read_answer(3, values))


def test_many_units_that_never_answer_are_one_cause(tmp_path: Path) -> None:
    def search() -> Iterator[bytes]:
        for _ in range(2):
            for unit in range(1, 60):
                yield (
                    exchange(unit, 0, [unit])
                    if unit in (3, 9)
                    else rtu(unit, read_request(3, 0, 1))
                )

    sentence, rows = judged(search(), tmp_path)
    assert [row["code"] for row in rows] == ["dead_unit_cost"]
    assert "Units 1, 2, 4 to 8 and 10 to 59, 57 of 59 that were asked, never answer" in sentence


def test_a_line_where_nobody_answers_is_no_matter_of_each_unit(tmp_path: Path) -> None:
    frames = (rtu(unit, read_request(4, 100, 2)) for _ in range(ROUNDS) for unit in (1, 2, 5))
    sentence, rows = judged(frames, tmp_path)
    assert [row["code"] for row in rows] == ["dead_unit_cost"]
    assert "Units 1, 2 and 5, all 3 that were asked, never answer" in sentence
    assert "all units have in common" in rows[0]["advice"]


def test_two_dead_units_among_others_are_told_one_by_one(tmp_path: Path) -> None:
    def line() -> Iterator[bytes]:
        for _ in range(ROUNDS):
            for unit in range(1, 6):
                yield exchange(unit, 0, [unit]) if unit < 4 else rtu(unit, read_request(3, 0, 1))

    _, rows = judged(line(), tmp_path)
    assert {(row["code"], row["unit"]) for row in rows} == {
        ("dead_unit_cost", 4),
        ("dead_unit_cost", 5),
    }


def test_a_unit_that_refuses_all_addresses_is_one_cause(tmp_path: Path) -> None:
    def line() -> Iterator[bytes]:
        for _ in range(ROUNDS):
            for address in range(40001, 40081, 10):
                yield rtu(7, read_request(3, address, 10)) + rtu(7, exception(3, 2))
            yield exchange(1, 0, [1, 2, 3])

    _, rows = judged(line(), tmp_path)
    assert [(row["code"], row["unit"]) for row in rows] == [("register_hole", 7)]
    assert rows[0]["sentence"].startswith("Nothing that was asked for (8 blocks) exists in unit 7")
    assert "40001" in rows[0]["advice"]


def test_rare_noise_explains_what_fails(tmp_path: Path) -> None:
    chance = random.Random(4)

    def line() -> Iterator[bytes]:
        for number in range(6000):
            frames = exchange(number % 4 + 1, 16 * (number % 7), [number & 0xFF, 500, 7, 9, 11])
            if chance.random() < 0.008:
                damaged = bytearray(frames)
                damaged[chance.randrange(11, len(frames) - 2)] ^= 1 << chance.randrange(8)
                frames = bytes(damaged)
            yield frames

    sentence, rows = judged(line(), tmp_path)
    assert [row["code"] for row in rows] == ["line_noise"]
    assert "The line is noisy" in sentence
    assert "no known cause" not in sentence
    assert "episodes" not in rows[0]["sentence"]


def test_answers_alone_are_said_to_be_alone(tmp_path: Path) -> None:
    frames = (rtu(2, read_answer(3, [number, 17, 4])) for number in range(50))
    sentence, rows = judged(frames, tmp_path)
    assert not rows
    assert "50 answers, and no request among them" in sentence


def test_a_function_that_is_not_known_needs_no_other_one(tmp_path: Path) -> None:
    frames = (
        rtu(9, read_request(3, 10 * (number % 6), 10)) + rtu(9, exception(3, 1))
        for number in range(60)
    )
    _, rows = judged(frames, tmp_path)
    assert [(row["code"], row["unit"]) for row in rows] == [("wrong_function", 9)]


def cut_answers(lost: slice) -> Iterator[bytes]:
    chance = random.Random(6)
    for _ in range(60):
        answer = rtu(3, read_answer(3, [chance.randrange(65536) for _ in range(4)]))
        yield rtu(3, read_request(3, 0, 4)) + answer[lost]


def test_answers_without_their_first_byte_are_of_no_other_rate(tmp_path: Path) -> None:
    _, rows = judged(cut_answers(slice(1, None)), tmp_path)
    assert [(row["code"], row["unit"]) for row in rows] == [("driver_enable", 3)]
    assert "first one or two bytes" in rows[0]["sentence"]


def test_answers_without_their_last_byte_are_of_no_other_rate(tmp_path: Path) -> None:
    _, rows = judged(cut_answers(slice(0, -1)), tmp_path)
    assert [(row["code"], row["unit"]) for row in rows] == [("driver_enable", 3)]
    assert "end of its answers" in rows[0]["sentence"]


def test_a_unit_that_answers_for_another_one_explains_all_of_it(tmp_path: Path) -> None:
    frames = (
        rtu(3, read_request(3, 0, 4)) + rtu(4, read_answer(3, [number, 1, 2, 3]))
        for number in range(60)
    )
    sentence, rows = judged(frames, tmp_path)
    assert [(row["code"], row["unit"]) for row in rows] == [("bystander", 4)]
    assert "Unit 4 answers requests to unit 3" in sentence
    assert rows[0]["explains"] == 60


def test_a_line_full_of_other_bytes_is_not_healthy(tmp_path: Path) -> None:
    chance = random.Random(3)
    frames = (
        exchange(1, 0, [number, 2]) + chance.randbytes(20).replace(b"\x01", b"\x02")
        for number in range(80)
    )
    sentence, _ = judged(frames, tmp_path)
    assert "is healthy" not in sentence


def refused_quantity(quantity: int) -> Iterator[bytes]:
    return (rtu(3, read_request(3, 0, quantity)) + rtu(3, exception(3, 3)) for _ in range(60))


def test_a_quantity_that_the_protocol_does_not_allow_is_no_hole(tmp_path: Path) -> None:
    sentence, rows = judged(refused_quantity(200), tmp_path)
    assert [row["code"] for row in rows] == ["block_too_long"]
    assert "blocks of 200 or more" in sentence
    assert "the protocol allows 1 to 125" in sentence
    sentence, _ = judged(refused_quantity(0), tmp_path)
    assert "takes no blocks of 0:" in sentence


def test_a_quantity_that_is_refused_may_be_too_great(tmp_path: Path) -> None:
    sentence, rows = judged(refused_quantity(10), tmp_path)
    assert [row["code"] for row in rows] == ["block_too_long"]
    assert "shorter ones were not asked for" in sentence


def one_behind(lengths: tuple[int, ...], rounds: int) -> Iterator[bytes]:
    """A master that asks for blocks of these sizes in turn and gets each answer one step late."""
    answer = b""
    for _ in range(rounds):
        for place, length in enumerate(lengths):
            yield rtu(9, read_request(3, 100 * place, length)) + answer
            answer = rtu(9, read_answer(3, [place * 1000 + at for at in range(length)]))
            if place == 0:
                yield exchange(4, 0, [7, 8])


def test_answers_as_long_as_the_request_before_asks_for_are_one_step_late(tmp_path: Path) -> None:
    _, rows = judged(one_behind((5, 6, 2, 3, 4), ROUNDS), tmp_path)
    assert [(row["code"], row["unit"]) for row in rows] == [("lockstep", 9)]


def test_a_unit_with_its_own_idea_of_lengths_is_not_one_step_late(tmp_path: Path) -> None:
    def line() -> Iterator[bytes]:
        for turn in range(ROUNDS):
            for length in (5, 5, 10):
                values = [turn + at for at in range(5)]
                yield rtu(9, read_request(3, length, length)) + rtu(9, read_answer(3, values))

    _, rows = judged(line(), tmp_path)
    assert "lockstep" not in [row["code"] for row in rows]


def held_line(seed: int, harm: bool) -> str:
    """A chunk log at 19200: after unit 3's answers, the request to unit 4 is mostly spoiled."""
    chance = random.Random(seed)
    now, lines = 1_790_000_000.0, []

    def send(data: bytes, pause: float) -> None:
        nonlocal now
        lines.append(json.dumps({"t": round(now, 6), "hex": data.hex()}))
        now += len(data) * 10 / 19200 + pause

    for turn in range(120):
        for unit in (5, 3, 4):
            request = rtu(unit, read_request(3, 10 * unit, 2))
            if unit == 4 and harm and chance.random() < 0.7:
                spoiled = bytes(chance.randrange(0x20, 0xF0) for _ in range(chance.randint(2, 5)))
                send(spoiled, 0.4)
                continue
            send(request, 0.012 + chance.random() * 0.004)
            send(rtu(unit, read_answer(3, [turn, unit])), 0.015 + chance.random() * 0.004)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_a_unit_that_holds_the_line_is_named(seed: int, tmp_path: Path) -> None:
    """No transaction fails: the requests that are lost are none."""
    path = tmp_path / "tap.jsonl"
    path.write_text(held_line(seed, harm=True))
    rows = decode(path, line="19200-8N1").doctor()["diagnoses"]
    assert [(row["code"], row["unit"]) for row in rows][:1] == [("driver_enable", 3)]
    path.write_text(held_line(seed, harm=False))
    assert decode(path, line="19200-8N1").doctor()["diagnoses"] == []
