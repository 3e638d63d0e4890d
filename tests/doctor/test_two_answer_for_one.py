"""Two devices answer for one address: the first one refuses at once, the second one answers.

The master takes the refusal and goes on, so that its next request meets the second answer.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from analyzer.line import Line
from tests.doctor.frames import exception, rtu
from tests.doctor.line_model import Answer, Exchange
from tests.doctor.plant import Plant, Poll, Unit
from tests.doctor.scene import Scene
from tests.doctor.test_evidence_of_lines import Changes, report
from tests.doctor.test_signs_of_senders import said
from tests.doctor.values import smooth

SEEDS = (81, 82, 83, 84)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_refusal_before_each_answer_is_a_second_device(seed: int, tmp_path: Path) -> None:
    rng = Random(seed)
    first, second, third = rng.sample(range(1, 60), 3)
    units = [
        Unit(unit, {3: {place: smooth(rng) for place in range(20)}}, 0.012, 0.1)
        for unit in (first, second, third)
    ]
    polls = [
        Poll(unit, 3, start, 6 + turn)
        for turn, unit in enumerate((first, second, third))
        for start in (0, 4)
    ]
    scene = Scene(rng, Plant(units, polls), Line(19_200, 8, "E", 1))
    scene.habits.pauses_s, scene.habits.retries = (0.008, 0.010, 0.012), 0
    scene.habits.timeout_s, scene.habits.period_s, scene.reads = 0.5, 0.5, "byte"

    def refuse(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit != first or not answers:
            return answers
        if rng.random() < 0.15:
            # Both begin at the same time, which leaves the same bytes.
            both = bytes([first ^ 0x40, 0x01]) + rng.randbytes(len(answers[0].data) - 2)
            return [Answer(both, 0.0055, right=False)]
        refusal = rtu(first, exception(3, rng.choice([1, 1, 2])))
        return [Answer(refusal, 0.0055), Answer(answers[0].data, rng.uniform(0.012, 0.014))]

    scene.run(400, Changes(refuse))
    found = said(report(scene, tmp_path))
    assert found[:1] == [("duplicate_address", first)]
    assert not {"polled_too_fast", "driver_enable", "wrong_function"} & {code for code, _ in found}
