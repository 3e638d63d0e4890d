"""What single registers and blocks tell: numbers that are no values, and where blocks begin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from tests.doctor.frames import read_request, rtu
from tests.doctor.test_joint import Tape

ANSWERS = 160


def record(value: Callable[[Random, int], int]) -> Tape:
    """Record answers of four registers; the third one holds what `value` says."""
    tape, rng = Tape(), Random(6)
    for number in range(ANSWERS):
        tape.add(rtu(2, read_request(3, 30, 4)), 40)
        registers = (200 + rng.randrange(9), 45_000, value(rng, number), rng.randrange(900))
        data = b"".join(register.to_bytes(2, "big") for register in registers)
        tape.add(rtu(2, bytes([3, len(data)]) + data), 8)
    return tape


@pytest.mark.parametrize("number", [0xFFFF, 0x8000, 0x7FFF])
def test_a_register_without_a_value_now_and_then_jumps(tmp_path: Path, number: int) -> None:
    tape = record(lambda rng, _: number if rng.random() < 0.07 else 2000 + rng.randrange(99))
    (found,) = tape.doctor(tmp_path)["diagnoses"]
    assert (found["code"], found["unit"], found["address"]) == ("value_spike", 2, 32)
    assert f"{number} ({number:04X})" in found["sentence"]


@pytest.mark.parametrize(
    "value",
    [
        lambda rng, _: rng.randrange(-3, 4) % 65_536,
        lambda rng, _: rng.choice([0, 0, 0, 1, 65_535]),
        lambda rng, _: rng.randrange(65_536),
        lambda _, number: 65_535 if 60 <= number < 90 else 2000,
        lambda rng, _: 65_535 if rng.random() < 0.9 else 7,
    ],
    ids=["signed", "small", "random", "a while", "mostly"],
)
def test_values_that_go_there_by_themselves_do_not(
    tmp_path: Path, value: Callable[[Random, int], int]
) -> None:
    assert record(value).codes(tmp_path) == []


def asked(blocks: dict[tuple[int, int], bool]) -> Tape:
    """Record requests for blocks, by address and quantity, and whether they are answered."""
    tape = Tape()
    for number in range(60):
        for (address, quantity), is_answered in blocks.items():
            tape.add(rtu(5, read_request(3, address, quantity)), 40)
            data = bytes([1 + address % 100, number % 50] * quantity)
            answer = bytes([3, len(data)]) + data if is_answered else b"\x83\x02"
            tape.add(rtu(5, answer), 8)
    return tape


def test_a_block_that_begins_one_too_late_may_have_a_hole(tmp_path: Path) -> None:
    (found,) = asked({(0, 5): True, (1, 10): False}).doctor(tmp_path)["diagnoses"]
    assert (found["code"], found["certainty"]) == ("address_off_by_one", "likely")
    assert "of 5 to 10 some do not exist" in found["sentence"]
    assert found["rival"] == "register_hole"
    assert found["odds"] < 2


def test_numbers_of_manuals_are_named(tmp_path: Path) -> None:
    (found,) = asked({(40_001, 10): False, (0, 10): True}).doctor(tmp_path)["diagnoses"]
    assert found["code"] == "address_off_by_one"
    assert "40001 is how manuals number address 0" in found["sentence"]


def test_a_hole_is_named_where_all_else_is_answered(tmp_path: Path) -> None:
    blocks = {(10, 20): False, (0, 20): True, (22, 10): True}
    (found,) = asked(blocks).doctor(tmp_path)["diagnoses"]
    assert found["code"] == "register_hole"
    assert "all but 20 and 21 of them were answered" in found["sentence"]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_registers_that_are_read_twice_change_together(tmp_path: Path, seed: int) -> None:
    """Two functions read the same registers, and all powers are 0 from one moment on."""
    tape, rng = Tape(), Random(seed)
    night = range(60, 100)
    for number in range(160):
        for function, quantity in ((3, 8), (4, 6), (4, 5)):
            tape.add(rtu(7, read_request(function, 10, quantity)), 40)
            power = 0 if number in night else 3000 + rng.randrange(20)
            values = [230, power, power, 17, power, 40, 41, 42][:quantity]
            data = b"".join(value.to_bytes(2, "big") for value in values)
            tape.add(rtu(7, bytes([function, len(data)]) + data), 8)
    assert tape.codes(tmp_path) == []


@pytest.mark.parametrize("writes", [6, 8])
def test_writes_of_the_same_values_that_begin_later_are_named(tmp_path: Path, writes: int) -> None:
    """Each of two set points is written too seldom to be sure, and both together are not."""
    tape = Tape()
    for number in range(300):
        tape.add(rtu(4, read_request(3, 0, 2)), 300)
        tape.add(rtu(4, bytes([3, 4, 0, number % 256, 0, 9])), 8)
        if number >= 150 and number % 9 == 0 and number < 150 + 18 * writes:
            write = rtu(4, bytes([6, 0, 4 + 2 * (number // 9 % 2), 1, 44]))
            tape.add(write, 40)
            tape.add(write, 8)
    document = tape.doctor(tmp_path)
    (found,) = document["diagnoses"]
    assert (found["code"], found["severity"], found["unit"]) == ("unexpected_writer", "info", 4)
    assert f"{2 * writes} writes of address 4 and of address 6" in found["sentence"]
    assert len(found["episodes"]) == 1


def test_a_few_writes_at_the_start_are_not(tmp_path: Path) -> None:
    tape = Tape()
    for number in range(300):
        tape.add(rtu(4, read_request(3, 0, 2)), 300)
        tape.add(rtu(4, bytes([3, 4, 0, number % 256, 0, 9])), 8)
        if number < 12:
            write = rtu(4, bytes([6, 0, number % 4, 1, 44]))
            tape.add(write, 40)
            tape.add(write, 8)
    assert tape.codes(tmp_path) == []
