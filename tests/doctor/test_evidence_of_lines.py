"""What a line shows of kinds of trouble that were missed on lines made by others.

Each is made with several seeds: plants, rates and ways to record differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from analyzer import decode
from analyzer.line import Line
from tests.doctor.frames import exception, rtu
from tests.doctor.line_model import Answer, Exchange, Trouble
from tests.doctor.plant import Plant, Poll, Unit, random_plant
from tests.doctor.recorded import EPOCH_S, chunk_log
from tests.doctor.scene import Scene
from tests.doctor.values import smooth

SEEDS = (11, 12, 13)
Report = dict[str, Any]


class Changes(Trouble):
    """Changes the answers by a function."""

    def __init__(self, change: Callable[[Exchange, list[Answer]], list[Answer]]) -> None:
        self.change = change

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """As the function says."""
        return self.change(exchange, answers) if answers else answers


def report(scene: Scene, folder: Path, line: str = "", reads: str = "") -> Report:
    data = chunk_log(scene.pair.heard(), reads or scene.reads, scene.character_s)
    return judged(data, line or str(scene.line), folder)


def judged(data: bytes, line: str, folder: Path) -> Report:
    path = folder / "tap.jsonl"
    path.write_bytes(data)
    return decode(path, line=line).doctor()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("is_same_length", [True, False])
@pytest.mark.parametrize(("lag", "said"), [(1, "one step"), (2, "two steps"), (3, "three steps")])
def test_answers_may_be_several_requests_late(
    seed: int, is_same_length: bool, lag: int, said: str, tmp_path: Path
) -> None:
    rng = Random(seed)
    sizes = [rng.randint(1, 4)] * 5 if is_same_length else rng.sample([1, 2, 3, 4, 6, 8, 10], 5)
    table = {40 * turn + place: smooth(rng) for turn in range(5) for place in range(12)}
    unit = Unit(rng.randint(1, 30), {3: table}, delay_s=0.02)
    polls = [Poll(unit.address, 3, 40 * turn, size) for turn, size in enumerate(sizes)]
    scene, kept = Scene(rng, Plant([unit], polls)), list[bytes]()
    scene.habits.retries, scene.habits.timeout_s = 0, 0.5

    def late(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.number < 100:
            return answers
        kept.append(answers[0].data)
        return [Answer(kept.pop(0), 0.0045)] if len(kept) > lag else []

    scene.run(250, Changes(late))
    row = report(scene, tmp_path)["diagnoses"][0]
    assert (row["code"], row["unit"]) == ("lockstep", unit.address)
    assert f"{said} late" in row["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("code", [2, 4, 6])
def test_each_spell_of_refusals_is_an_episode(seed: int, code: int, tmp_path: Path) -> None:
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=2))
    unit = scene.plant.units[0].address

    def refuse(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        in_spell = 150 <= exchange.number < 210 or 300 <= exchange.number < 330
        if exchange.unit == unit and in_spell:
            answers[0].data = rtu(unit, exception(exchange.request[1], code))
        return answers

    scene.run(500, Changes(refuse))
    row = report(scene, tmp_path)["diagnoses"][0]
    ends = [(one["first"], one["last"]) for one in row["episodes"]]
    assert [(first // 50, (last - 1) // 30) for first, last in ends] == [(3, 6), (6, 10)]
    assert "in 2 episodes" in row["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("swapped", [5, 150])
def test_swapped_checksums_are_counted_among_all_answers(
    seed: int, swapped: int, tmp_path: Path
) -> None:
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=2))
    unit = scene.plant.units[0].address
    hits, seen = set(rng.sample(range(150), swapped)), [0]

    def swap(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit == unit:
            data = answers[0].data
            # Two equal bytes are not swapped.
            if seen[0] in hits and data[-1] != data[-2]:
                answers[0] = Answer(data[:-2] + data[:-3:-1], answers[0].delay_s, right=False)
            seen[0] += 1
        return answers

    scene.habits.retries = 0
    master = scene.master(Changes(swap))
    for _ in master.steps():
        if seen[0] == 150:
            break
    row = report(scene, tmp_path)["diagnoses"][0]
    assert (row["code"], row["unit"], row["total"]) == ("wrong_layout", unit, 150)
    assert swapped - 3 <= row["failed"] <= swapped


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("reads", ["byte", "millisecond", "fifo"])
@pytest.mark.parametrize(("real", "given"), [(57_600, 19_200), (19_200, 9600), (9600, 4800)])
def test_bytes_that_come_too_fast_name_the_rate(
    seed: int, reads: str, real: int, given: int, tmp_path: Path
) -> None:
    scene = Scene(Random(seed), random_plant(Random(seed), units=3), Line(real, 8, "E", 1))
    scene.run(200)
    found = report(scene, tmp_path, f"{given}-8E1", reads)
    row = found["diagnoses"][0]
    assert (row["code"], row["unit"]) == ("wrong_line_settings", None)
    assert f"faster than {given}; {real} fits" in row["sentence"]
    assert found["verdict"] != "healthy"


@pytest.mark.parametrize("seed", SEEDS)
def test_bytes_that_all_come_at_half_the_rate_name_it(seed: int, tmp_path: Path) -> None:
    scene = Scene(Random(seed), random_plant(Random(seed), units=3), Line(4800, 8, "E", 1))
    scene.run(200)
    row = report(scene, tmp_path, "9600-8E1", "byte")["diagnoses"][0]
    assert "slower than 9600; 4800 fits" in row["sentence"]
    rows = report(scene, tmp_path, "4800-8E1", "byte")["diagnoses"]
    assert "wrong_line_settings" not in [row["code"] for row in rows]


JUMPS: dict[str, Callable[[int], int]] = {
    "0": lambda _: 0,
    "ten times": lambda value: value * 10 % 65_536,
    "the negative of": lambda value: -value % 65_536,
    "65535": lambda _: 65_535,
}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("said", JUMPS)
def test_a_register_that_jumps_for_single_reads_is_named(
    seed: int, said: str, tmp_path: Path
) -> None:
    rng = Random(seed)
    level = rng.randint(300, 3000)
    table = {place: smooth(rng) for place in range(10)}
    register = rng.randrange(10)
    table[register] = lambda time_s: level + int(time_s) % 3
    unit = Unit(rng.randint(1, 30), {3: table})
    scene = Scene(rng, Plant([unit], [Poll(unit.address, 3, 0, 10)]))
    hits = set(rng.sample(range(20, 380, 9), 4))

    def jump(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.number in hits:
            data, at = bytearray(answers[0].data[1:-2]), 2 + 2 * register
            value = JUMPS[said](int.from_bytes(data[at : at + 2], "big"))
            data[at : at + 2] = value.to_bytes(2, "big")
            answers[0].data = rtu(unit.address, bytes(data))
        return answers

    scene.habits.retries = 0
    scene.run(400, Changes(jump))
    rows = report(scene, tmp_path)["diagnoses"]
    assert [(row["code"], row["address"], row["failed"]) for row in rows] == [
        ("value_spike", register, 4)
    ]
    assert f"are {said}" in rows[0]["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
def test_noise_after_a_write_names_its_register(seed: int, tmp_path: Path) -> None:
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=3, functions=(3,)))
    written = scene.plant.units[rng.randrange(3)]
    # A read comes after each of them: the answer to a write is not what a write disturbs.
    for register, place in ((40, 1), (41, len(scene.plant.polls) + 1)):
        written.tables[3][register] = lambda _: 0
        poll = Poll(written.address, 6, register, 1, lambda time_s: [int(time_s) % 7], 3)
        scene.plant.polls.insert(place, poll)
    after = [False]

    def disturb(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if after[0]:
            data = bytearray(answers[0].data)
            for _ in range(6):
                data[rng.randrange(len(data))] ^= rng.randrange(1, 256)
            answers[0] = Answer(bytes(data), answers[0].delay_s, right=False)
        is_start = exchange.poll.values is not None and exchange.poll.address == 40
        after[0] = is_start and rng.random() < 0.8
        return answers

    scene.habits.retries = 1
    scene.run(500, Changes(disturb))
    row = report(scene, tmp_path)["diagnoses"][0]
    assert (row["code"], row["unit"], row["address"]) == ("line_noise", written.address, 40)
    assert f"after writes of register 40 to unit {written.address}" in row["sentence"]


@pytest.mark.parametrize("seed", [12, 13, 14, 15])
@pytest.mark.parametrize("times", [1.3, 1.6])
def test_a_master_without_retries_gives_up_too_soon(
    seed: int, times: float, tmp_path: Path
) -> None:
    """The unit answers into the next request: it is neither dead nor two devices."""
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=3))
    scene.habits.retries, scene.habits.timeout_s, scene.habits.pauses_s = 0, 0.2, (0.01,)
    for unit in scene.plant.units:
        unit.delay_s = 0.02
    slow = scene.plant.units[1]
    slow.delay_s, slow.spread = 0.2 * times, 0.1
    scene.run(300)
    row = report(scene, tmp_path)["diagnoses"][0]
    assert (row["code"], row["unit"]) == ("slow_answers", slow.address)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_unit_without_answers_is_dead_where_the_master_does_not_repeat(
    seed: int, tmp_path: Path
) -> None:
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=3))
    dead = scene.plant.units[1].address
    scene.habits.retries = 0
    scene.run(250, Changes(lambda exchange, answers: [] if exchange.unit == dead else answers))
    codes = [(row["code"], row["unit"]) for row in report(scene, tmp_path)["diagnoses"]]
    assert codes[:1] == [("dead_unit_cost", dead)]


@pytest.mark.parametrize("seed", range(20, 26))
def test_the_timer_of_a_recorder_is_no_pause_of_a_sender(seed: int, tmp_path: Path) -> None:
    rng = Random(seed)
    line = Line(rng.choice([9600, 19_200]), 8, "N", 1)
    scene = Scene(rng, random_plant(rng, units=3), line)
    scene.run(300)
    tick = rng.choice([0.010, 0.0156, 0.016])
    ticks: dict[int, bytearray] = {}
    for time_s, byte in sorted(scene.pair.heard()):
        ticks.setdefault(math.ceil(time_s / tick), bytearray()).append(byte)
    lines = (
        f'{{"t": {EPOCH_S + number * tick:.6f}, "hex": "{data.hex()}"}}\n'
        for number, data in ticks.items()
    )
    rows = judged("".join(lines).encode(), str(line), tmp_path)["diagnoses"]
    assert "gaps_in_frames" not in [row["code"] for row in rows]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kinds_of_damage", [3, 6])
def test_a_few_answers_without_checksum_are_no_layout(
    seed: int, kinds_of_damage: int, tmp_path: Path
) -> None:
    """Where others are spoiled elsewhere, what took two bytes of some was no program."""
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=2, functions=(3,)))
    unit = scene.plant.units[0].address

    answered = [0]

    def spoil(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit != unit:
            return answers
        answered[0] += 1
        turn, rest = divmod(answered[0], 3)
        if rest == 0:
            kind, data = turn % kinds_of_damage, bytearray(answers[0].data)
            data[kind] ^= 0x5A if kind else 0
            whole = bytes(data if kind else data[:-2])
            answers[0] = Answer(whole, answers[0].delay_s, right=False)
        return answers

    scene.habits.retries = 0
    scene.run(400, Changes(spoil))
    codes = [row["code"] for row in report(scene, tmp_path)["diagnoses"]]
    assert "wrong_layout" not in codes
