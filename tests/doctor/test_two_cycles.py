"""One list of requests in two cycles that drift: two masters, or two clients of one gateway."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest

from tests.doctor.frames import read_request, rtu
from tests.doctor.test_joint import Tape

CYCLES_S = (1.0, 1.012)
REQUESTS = 400
MEETING_S = 0.09


def record(is_damaged: Callable[[float], bool]) -> Tape:
    """Two clients ask units 3 and 4; `is_damaged` is asked with the time since the other began."""
    starts = sorted(
        0.4 * client + cycle * number
        for client, cycle in enumerate(CYCLES_S)
        for number in range(REQUESTS)
    )
    tape, rng = Tape(), Random(5)
    begin = tape.now
    for before, start in pairwise([-1.0, *starts]):
        # An exchange begins 40 ms after the end of the one before.
        tape.now = max(tape.now, begin + int(start * 1e9) - 40_000_000)
        for unit in (3, 4):
            tape.add(rtu(unit, read_request(3, 0, 4)), 40)
            answer = bytearray(rtu(unit, bytes([3, 8, 0, rng.randrange(256), 1, 44, 0, 20, 8, 2])))
            if is_damaged(start - before):
                answer[rng.randrange(3, len(answer))] ^= 1 << rng.randrange(8)
            tape.add(bytes(answer), 8)
    return tape


def test_damage_where_the_two_meet_is_that_of_two_masters(tmp_path: Path) -> None:
    assert record(lambda apart: apart < MEETING_S).codes(tmp_path) == ["two_masters"]


def test_damage_at_any_time_is_not(tmp_path: Path) -> None:
    """A gateway sends the requests of its clients one after the other: they never meet."""
    rng = Random(8)
    assert record(lambda _: rng.random() < 0.1).codes(tmp_path) == ["line_noise"]


def test_two_cycles_are_no_trouble(tmp_path: Path) -> None:
    assert record(lambda _: False).codes(tmp_path) == []


@pytest.mark.parametrize("seed", range(4))
def test_one_master_with_a_time_for_each_request_is_one(seed: int, tmp_path: Path) -> None:
    """A unit that fails after the answers of another one spoils no byte, as two that meet do."""
    rng, tape = Random(seed), Tape()
    units = rng.sample(range(1, 60), 4)
    polls = [(units[at], 10 * at, rng.uniform(1.0, 1.8)) for at in (0, 1, 1, 2, 2, 3)]
    due = [rng.random() for _ in polls]
    begin, before = tape.now, 0
    while min(due) < 300:
        at = due.index(min(due))
        unit, address, every = polls[at]
        tape.now = max(tape.now, begin + int(due[at] * 1e9))
        tape.add(rtu(unit, read_request(3, address + at, 2)), 20)
        if unit == units[2] and before == units[1] and rng.random() < 0.9:
            tape.now += 300_000_000
        else:
            tape.add(rtu(unit, bytes([3, 4, 7 * at, rng.randrange(256), 1, 44 + at])), 12)
        due[at], before = due[at] + every, unit
    assert tape.codes(tmp_path) == ["bystander"]


@pytest.mark.parametrize("seed", [2, 3, 5])
def test_requests_that_lose_their_last_byte_are_those_of_one_master(
    seed: int, tmp_path: Path
) -> None:
    """The master's driver is off too early at two requests of five; what is left ends as FF."""
    tape, rng = Tape(), Random(seed)
    for number in range(320):
        unit, quantity, pause_ms = ((4, 8, 63), (9, 6, 43), (12, 10, 43))[number % 3]
        request = rtu(unit, read_request(3, 20 * unit, quantity))
        is_cut = rng.random() < 0.4
        tape.add(request[:-1] if is_cut else request, pause_ms + rng.uniform(0, 4))
        if is_cut:
            if rng.random() < 0.5:
                tape.add(b"\xff", 0.5 if rng.random() < 0.5 else 3)
            tape.now += int(rng.uniform(245, 252) * 1e6)
        else:
            values = rng.randbytes(quantity * 2)
            tape.add(rtu(unit, bytes([3, quantity * 2]) + values), rng.uniform(6, 19))
        if number % 40 == 21:
            tape.now += 80_000_000
    assert tape.codes(tmp_path) == ["driver_enable"]
