"""Signs by which a driver, a receiver and a limit differ from noise, two devices and a slow unit.

Each is made with several seeds: plants, rates and ways to record differ.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from pathlib import Path
from random import Random

import pytest

from analyzer.line import Line
from tests.doctor.line_model import Answer, Exchange
from tests.doctor.plant import Plant, Poll, Unit, random_plant
from tests.doctor.scene import Scene
from tests.doctor.test_evidence_of_lines import Changes, Report, report
from tests.doctor.values import smooth

SEEDS = (21, 22, 23, 24)
LINES = (Line(9600, 8, "E", 1), Line(19_200, 8, "E", 1), Line(38_400, 8, "N", 1))
Said = list[tuple[str, int | None]]


def said(found: Report) -> Said:
    rows = [row for row in found["diagnoses"] if row["severity"] != "info"]
    return [(row["code"], row["unit"]) for row in rows]


def three_units(rng: Random, line: Line, delay_s: float = 0.008) -> Scene:
    """Three units with blocks of several lengths, of which the first two answer soon."""
    addresses = rng.sample(range(1, 60), 3)
    tables = [{place: smooth(rng) for place in range(12)} for _ in addresses]
    units = [
        Unit(address, {3: table}, delay_s, 0.5)
        for address, table in zip(addresses, tables, strict=True)
    ]
    units[2].delay_s = 0.06
    polls = [Poll(unit.address, 3, 0, rng.randint(4, 12)) for unit in units]
    scene = Scene(rng, Plant(units, polls), line)
    scene.habits.retries, scene.habits.timeout_s, scene.reads = rng.randint(0, 1), 0.3, "byte"
    return scene


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("line", LINES, ids=str)
def test_a_driver_that_a_unit_releases_too_soon_spoils_the_end_of_its_answers(
    seed: int, line: Line, tmp_path: Path
) -> None:
    """The line idles high: the bits that the driver does not send any more are read as 1."""
    rng = Random(seed)
    scene = three_units(rng, line)
    unit = scene.plant.units[seed % 3].address

    def release(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit != unit or rng.random() > 0.65:
            return answers
        data = answers[0].data
        last = data[-1] | 0xFF << rng.randint(2, 7) & 0xFF
        return [replace(answers[0], data=data[:-1] + bytes([last]), right=last == data[-1])]

    scene.run(400, Changes(release))
    assert said(report(scene, tmp_path)) == [("driver_enable", unit)]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("line", LINES, ids=str)
def test_a_driver_that_the_master_holds_too_long_spoils_soon_answers(
    seed: int, line: Line, tmp_path: Path
) -> None:
    """What begins while it is held is lost; the receiver then starts inside a byte, twice or so."""
    rng = Random(seed)
    scene = three_units(rng, line)
    hold_s = 0.009

    def hold(_: Exchange, answers: list[Answer]) -> list[Answer]:
        one = answers[0]
        if one.delay_s >= hold_s:
            return answers
        lost = min(ceil((hold_s - one.delay_s) / scene.character_s), len(one.data) - 4)
        out_of_step = [rng.randrange(256) for _ in range(rng.randint(0, 2))]
        data = bytes(out_of_step) + one.data[lost + len(out_of_step) :]
        return [Answer(data, one.delay_s + lost * scene.character_s, right=False)]

    scene.run(500, Changes(hold))
    found = said(report(scene, tmp_path))
    quick = {unit.address for unit in scene.plant.units[:2]}
    assert {code for code, _ in found} == {"driver_enable"}
    assert {unit for _, unit in found} <= quick


@pytest.mark.parametrize("seed", SEEDS)
def test_a_driver_that_the_master_holds_now_and_then_spoils_fast_units(
    seed: int, tmp_path: Path
) -> None:
    """Two units always answer sooner than it may be held, and the third one never does."""
    rng = Random(seed)
    scene = three_units(rng, LINES[1], delay_s=0.005)
    for unit in scene.plant.units:
        unit.spread = 0.05

    def hold(_: Exchange, answers: list[Answer]) -> list[Answer]:
        one = answers[0]
        lost = ceil((rng.uniform(0.005, 0.01) - one.delay_s) / scene.character_s)
        if one.delay_s > 0.012 or lost <= 0:
            return answers
        lost = min(lost, 4)
        return [Answer(one.data[lost:], one.delay_s + lost * scene.character_s, right=False)]

    scene.run(240, Changes(hold))
    found = said(report(scene, tmp_path))
    assert {code for code, _ in found} == {"driver_enable"}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("line", LINES, ids=str)
def test_answers_of_zeros_of_the_right_length_are_a_matter_of_parity(
    seed: int, line: Line, tmp_path: Path
) -> None:
    """A receiver that checks the parity writes 00 for each wrong byte."""
    rng = Random(seed)
    scene = three_units(rng, line)
    unit = scene.plant.units[seed % 3].address

    def zeros(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit != unit:
            return answers
        return [replace(answers[0], data=bytes(len(answers[0].data)), right=False)]

    scene.run(200, Changes(zeros))
    assert said(report(scene, tmp_path)) == [("wrong_line_settings", unit)]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("is_limit", [True, False])
def test_a_unit_may_be_silent_for_longer_blocks_of_both_functions(
    seed: int, is_limit: bool, tmp_path: Path
) -> None:
    """Of a unit that does not know function 4 at all, and says nothing, it is not the length."""
    rng = Random(seed)
    limit = rng.choice([30, 48, 64])
    table = {place: smooth(rng) for place in range(125)}
    unit, other = (Unit(address, {3: table, 4: table}) for address in rng.sample(range(1, 60), 2))
    lengths = [(3, limit // 4), (3, limit // 2), (4, limit + 40)]
    lengths += [(3, limit + 10)] if is_limit else [(4, limit + 20)]
    polls = [Poll(unit.address, function, 0, length) for function, length in lengths]
    polls += [Poll(other.address, 4, 0, 100)]
    scene = Scene(rng, Plant([unit, other], polls))
    scene.habits.timeout_s = 0.5

    def silent(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        is_long = exchange.poll.quantity > limit and exchange.unit == unit.address
        return [] if is_long else answers

    scene.run(200, Changes(silent))
    found = said(report(scene, tmp_path))
    assert (("block_too_long", unit.address) in found) == is_limit
    assert not is_limit or len(found) == 1


@pytest.mark.parametrize("seed", SEEDS)
def test_a_unit_that_was_away_is_no_bystander(seed: int, tmp_path: Path) -> None:
    """It is asked twice in turn: after itself only while it is there."""
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=3))
    unit = scene.plant.units[2].address
    scene.plant.polls += [
        replace(poll, address=poll.address) for poll in scene.plant.polls if poll.unit == unit
    ]
    scene.habits.retries = 1

    def away(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        is_away = 100 <= exchange.number < 200 or 320 <= exchange.number < 440
        return [] if is_away and exchange.unit == unit else answers

    scene.run(600, Changes(away))
    assert said(report(scene, tmp_path)) == [("device_absent", unit)]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_search_that_is_over_is_no_trouble_of_the_line(seed: int, tmp_path: Path) -> None:
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=3))
    scene.habits.retries = 0
    there = {unit.address for unit in scene.plant.units}
    search = [Poll(unit, 3, 0, 1) for unit in range(1, 31) if unit not in there]
    polls = scene.plant.polls
    scene.plant.polls = search
    master = scene.master()
    master.run(len(search))
    scene.plant.polls = polls
    master.run(len(search) + 300)
    found = report(scene, tmp_path)
    rows = [(row["code"], row["severity"]) for row in found["diagnoses"]]
    assert (found["verdict"], rows) == ("healthy", [("dead_unit_cost", "info")])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("turn", [1, 2, 3])
def test_an_answer_that_a_modem_keeps_back_waits_while_others_are_asked(
    seed: int, turn: int, tmp_path: Path
) -> None:
    """Another unit, whose answers are right, is asked between the blocks of the first."""
    rng = Random(seed)
    address, other = rng.sample(range(1, 60), 2)
    table = {40 * block + place: smooth(rng) for block in range(4) for place in range(8)}
    units = [Unit(address, {3: table}, 0.02), Unit(other, {3: {0: smooth(rng)}}, 0.01)]
    length = rng.randint(2, 8)
    polls = [Poll(address, 3, 40 * block, length) for block in range(4)]
    polls.insert(turn, Poll(other, 3, 0, 1))
    scene, kept = Scene(rng, Plant(units, polls)), list[bytes]()
    scene.habits.retries = 0

    def late(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.number < 150 or exchange.unit != address:
            return answers
        kept.append(answers[0].data)
        return [replace(answers[0], data=kept.pop(0))] if len(kept) > 1 else []

    scene.run(450, Changes(late))
    row = report(scene, tmp_path)["diagnoses"][0]
    assert (row["code"], row["unit"]) == ("lockstep", address)
    assert "one step late" in row["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
def test_each_spell_of_late_answers_is_an_episode(seed: int, tmp_path: Path) -> None:
    """They come after the next request, to a unit that takes longer."""
    rng = Random(seed)
    scene = three_units(rng, LINES[1])
    scene.habits.retries, scene.habits.pauses_s = 0, (0.03,)
    scene.plant.units[2].spread = 0.05
    unit = scene.plant.units[1].address
    spells = (range(90, 150), range(300, 375))

    def slow(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit == unit and any(exchange.number in spell for spell in spells):
            is_late = rng.random() < 0.7
            delay_s = rng.uniform(0.34, 0.35) if is_late else 0.2
            answers[0] = replace(answers[0], delay_s=delay_s, right=not is_late)
        return answers

    exchanges = scene.run(500, Changes(slow))
    failed = [one.number + 1 for one in exchanges if one.unit == unit and one.outcome != "ok"]
    rows = report(scene, tmp_path)["diagnoses"]
    assert [(row["code"], row["unit"]) for row in rows] == [("slow_answers", unit)]
    ends = [(one["first"], one["last"]) for one in rows[0]["episodes"]]
    first = [number for number in failed if number < 200]
    second = [number for number in failed if number > 200]
    assert len(ends) == 2
    assert abs(ends[0][0] - first[0]) <= 3
    assert ends[1][1] >= second[0]
