"""Another protocol of which two bytes are known: they come again, and by a clock of their own."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from tests.doctor.line_model import Answer, Exchange, Trouble
from tests.doctor.plant import random_plant
from tests.doctor.scene import Scene
from tests.doctor.test_evidence_of_lines import Changes, report
from tests.doctor.test_signs_of_senders import said

SEEDS = (71, 72, 73)


def scene_of(seed: int) -> Scene:
    """A line that is asked each second, by units below 32, and is free most of the time."""
    rng = Random(seed)
    scene = Scene(rng, random_plant(rng, units=2, functions=(3,)))
    scene.habits.retries, scene.habits.period_s = 0, 1.0
    scene.habits.pauses_s = (0.02,)
    scene.reads = "byte"
    return scene


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("head", [b"\xa5\x5a", b"\x7e\xb1"])
def test_frames_of_two_known_bytes_come_by_their_own_clock(
    seed: int, head: bytes, tmp_path: Path
) -> None:
    scene = scene_of(seed)
    until_s = scene.run(200)[-1].start_s
    rng, period_s, at_s = scene.rng, 2.37 + seed % 3 / 10, 0.4
    while at_s < until_s:
        scene.pair.put(at_s, head + rng.randbytes(rng.randint(5, 14)))
        at_s += period_s * rng.uniform(0.997, 1.003)
    found = report(scene, tmp_path)
    codes = [code for code, _ in said(found)]
    assert "foreign_protocol" in codes
    assert not {"two_masters", "wrong_line_settings", "driver_enable"} & set(codes)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_left_of_requests_is_no_other_protocol(seed: int, tmp_path: Path) -> None:
    """The first byte of requests to one unit is lost at times: what is left begins alike."""
    scene = scene_of(seed)
    unit = scene.plant.units[0].address

    class Late(Trouble):
        def request(self, exchange: Exchange) -> bytes:
            is_lost = exchange.unit == unit and scene.rng.random() < 0.4
            return exchange.request[1:] if is_lost else exchange.request

    scene.run(200, Late())
    assert "foreign_protocol" not in [code for code, _ in said(report(scene, tmp_path))]


@pytest.mark.parametrize("seed", SEEDS)
def test_bytes_that_follow_each_answer_are_no_other_protocol(seed: int, tmp_path: Path) -> None:
    """They come when the master asks."""
    scene = scene_of(seed)
    unit, rng = scene.plant.units[0].address, scene.rng

    def more(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit != unit:
            return answers
        rest = Answer(b"\xa7\x5c" + rng.randbytes(4), answers[0].delay_s + 0.2, right=False)
        return [*answers, rest]

    scene.run(200, Changes(more))
    assert "foreign_protocol" not in [code for code, _ in said(report(scene, tmp_path))]
