"""What a refusal means: exception 1 the function, exception 2 the addresses (section 7)."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from tests.doctor.frames import exception, rtu
from tests.doctor.line_model import Answer, Exchange
from tests.doctor.plant import Plant, Poll, Unit
from tests.doctor.scene import Scene
from tests.doctor.test_evidence_of_lines import Changes, Report, report
from tests.doctor.values import smooth

SEEDS = (51, 52)


def refusing(seed: int, bad: list[Poll], code: int, folder: Path) -> Report:
    """A line with two units, of which unit 7 refuses these polls with a code."""
    rng = Random(seed)
    units = [
        Unit(unit, {3: {place: smooth(rng) for place in range(40)}})
        for unit in (7, rng.choice([1, 40]))
    ]
    good = [Poll(unit.address, 3, first, 4) for unit in units for first in (0, 10)]

    def refuse(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.poll not in bad:
            return answers
        return [Answer(rtu(7, exception(exchange.poll.function, code)), 0.006)]

    scene = Scene(rng, Plant(units, good + bad))
    scene.run(200, Changes(refuse))
    return report(scene, folder)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("bad", "code", "said"),
    [
        # The function is refused at the only block that it is asked for.
        ([Poll(7, 4, 20, 2)], 1, "wrong_function"),
        ([Poll(7, 4, 10, 4)], 2, "wrong_function"),
        ([Poll(7, 4, 500, 2)], 2, "register_hole"),
        ([Poll(7, 1, 3, 8)], 1, "wrong_function"),
        # Coils are no registers, whatever their numbers are.
        ([Poll(7, 1, 3, 8)], 2, "register_hole"),
        ([Poll(7, 6, 900, 1, lambda time_s: [int(time_s)])], 2, "register_hole"),
        # The function is answered at other addresses: exception 1 means those that are refused.
        ([Poll(7, 3, 600, 3)], 1, "register_hole"),
        ([Poll(7, 3, 600, 3)], 2, "register_hole"),
    ],
)
def test_a_refusal_means_what_its_exception_says(
    seed: int, bad: list[Poll], code: int, said: str, tmp_path: Path
) -> None:
    rows = refusing(seed, bad, code, tmp_path)["diagnoses"]
    assert [(row["code"], row["unit"]) for row in rows] == [(said, 7)]


@pytest.mark.parametrize("seed", SEEDS)
def test_bits_are_not_answered_where_registers_are(seed: int, tmp_path: Path) -> None:
    [row] = refusing(seed, [Poll(7, 1, 3, 8)], 1, tmp_path)["diagnoses"]
    assert "refuses function 1 throughout" in row["sentence"]
    assert "answers there" not in row["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
def test_exception_1_of_some_addresses_is_named(seed: int, tmp_path: Path) -> None:
    [row] = refusing(seed, [Poll(7, 3, 600, 3)], 1, tmp_path)["diagnoses"]
    assert "(exception 1), and others for function 3 were answered" in row["sentence"]
