"""Two troubles on one line, a trouble that is over, and how little suffices to name one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from random import Random

import pytest

from tests.doctor.case import Case
from tests.doctor.examine import Row, diagnose, ran, subject_fits, written
from tests.doctor.kinds.damage import Noise
from tests.doctor.kinds.silences import Dead
from tests.doctor.kinds.values_written import Busy
from tests.doctor.line_model import Answer, Exchange, Habits, Trouble
from tests.doctor.plant import Poll, random_plant
from tests.doctor.scene import Scene


class Both(Trouble):
    """One trouble after the other has its say."""

    def __init__(self, *troubles: Trouble) -> None:
        self.troubles = troubles

    def request(self, exchange: Exchange) -> bytes:
        """Of those who change it, the last."""
        changed = [trouble.request(exchange) for trouble in self.troubles]
        return next((data for data in changed[::-1] if data != exchange.request), exchange.request)

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """Each gets what the one before has left."""
        for trouble in self.troubles:
            answers = trouble.answers(exchange, answers)
        return answers


class Until(Noise):
    """Noise that ends."""

    last = 0

    def _strikes(self, exchange: Exchange, answer: bool) -> bool:
        return exchange.number < self.last and super()._strikes(exchange, answer)


def examined(case: Case, folder: Path) -> list[Row]:
    written(case, folder)
    return diagnose(case.main, case.words, folder)


def codes(rows: Sequence[Row]) -> list[str]:
    return [row["code"] for row in rows]


def plain_scene(seed: int, units: int = 3) -> Scene:
    scene = Scene(Random(seed), random_plant(Random(seed), units=units))
    scene.habits = Habits(timeout_s=0.2)
    return scene


def test_two_troubles_are_both_named_each_with_its_share(tmp_path: Path) -> None:
    scene = plain_scene(11)
    dead, busy, _ = (unit.address for unit in scene.plant.units)
    exchanges = scene.run(600, Both(Dead(scene.rng, dead, 0.0), Busy(scene.rng, busy, 6, 0.4)))
    rows = examined(scene.case("dead_unit_cost", unit=dead), tmp_path)
    by_code = {row["code"]: row for row in rows}
    assert {"dead_unit_cost", "device_busy"} <= set(by_code)
    for code, unit in (("dead_unit_cost", dead), ("device_busy", busy)):
        struck = sum(one.struck or unit == dead for one in exchanges if one.unit == unit)
        assert by_code[code]["unit"] == unit
        assert abs(by_code[code]["failed"] - struck) <= 1


@pytest.mark.parametrize("seed", range(41, 45))
def test_a_unit_that_is_not_there_is_named_on_a_noisy_line(seed: int, tmp_path: Path) -> None:
    """A damaged request reaches no unit, and says nothing against one."""
    scene = plain_scene(seed, units=4)
    dead = scene.plant.units[seed % 4].address
    scene.run(600, Both(Dead(scene.rng, dead, 0.0), Noise(scene.rng, 0.15)))
    rows = examined(scene.case("dead_unit_cost", unit=dead), tmp_path)
    named = {(row["code"], row["unit"]) for row in rows if row["severity"] == "error"}
    assert named == {("line_noise", None), ("dead_unit_cost", dead)}


def test_a_trouble_that_ended_says_until_when(tmp_path: Path) -> None:
    scene = plain_scene(12)
    trouble = Until(scene.rng, 0.2)
    trouble.last = 400
    exchanges = scene.run(1000, trouble)
    case = scene.case("line_noise")
    row = next(row for row in examined(case, tmp_path) if row["code"] == "line_noise")
    out = ran("decode", case.main, *case.words, "--to", "jsonl", cwd=tmp_path)
    rows = [json.loads(line) for line in out.splitlines()]
    over = sum(one.number < 400 for one in exchanges) / len(exchanges)
    at = next(place for place, one in enumerate(rows) if one["time"] >= row["until"])
    assert abs(at / len(rows) - over) < 0.05


def test_ten_requests_suffice_for_a_unit_that_is_not_there(tmp_path: Path) -> None:
    scene = plain_scene(13)
    dead = scene.plant.units[0].address
    scene.plant.polls = [
        next(poll for poll in scene.plant.polls if poll.unit == unit.address)
        for unit in scene.plant.units
    ]
    scene.run(30, Dead(scene.rng, dead, 0.0))
    case = scene.case("dead_unit_cost", unit=dead)
    assert case.expected is not None
    rows = examined(case, tmp_path)
    assert any(subject_fits(row, case.expected) for row in rows), codes(rows)


def test_ten_requests_suffice_for_a_register_that_is_not_there(tmp_path: Path) -> None:
    scene = plain_scene(14, units=1)
    unit = scene.plant.units[0]
    function = next(iter(unit.tables))
    table = unit.tables[function]
    table.clear()
    table.update({place: (lambda _, k=place: 1000 + k) for place in range(500, 520)})  # type: ignore[misc]
    del table[511]
    reads = ((500, 20), (500, 11), (512, 8))
    scene.plant.polls = [Poll(unit.address, function, start, size) for start, size in reads]
    scene.run(30)
    case = scene.case("register_hole", unit=unit.address, function=function)
    assert case.expected is not None
    rows = examined(case, tmp_path)
    assert any(subject_fits(row, case.expected) for row in rows), codes(rows)


def test_two_lost_answers_are_no_reason_for_a_diagnosis(tmp_path: Path) -> None:
    """Silence where there is not enough."""
    scene = plain_scene(15)

    class Twice(Trouble):
        """The tenth and the fiftieth answer are lost."""

        def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
            """None of those two."""
            return [] if exchange.number in (10, 50) else answers

    scene.run(80, Twice())
    assert [row["code"] for row in examined(scene.case(None), tmp_path)] == []
