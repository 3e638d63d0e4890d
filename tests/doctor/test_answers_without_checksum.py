"""A unit that leaves the checksum out of its answers, to whatever it is asked.

The requests have one. From a few answers on, a reader takes them for what they are.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from tests.doctor.line_model import Answer, Exchange
from tests.doctor.plant import Plant, Poll, Unit
from tests.doctor.scene import Scene
from tests.doctor.test_evidence_of_lines import Changes, report
from tests.doctor.values import smooth

SEEDS = (61, 62, 63)
READ_FIFO = 24


class Queue(Poll):
    """A read of a queue, whose request has an address only (section 6.18)."""

    def pdu(self, _: float) -> bytes:
        """Function and address."""
        return struct.pack(">BH", READ_FIFO, self.address)


class WithQueue(Unit):
    """A unit with a queue of a few registers."""

    def answer(self, pdu: bytes, time_s: float) -> bytes:
        """The byte count, the number of registers, and those."""
        if pdu[0] != READ_FIFO:
            return super().answer(pdu, time_s)
        values = [int(time_s * 7 + place) & 0xFFFF for place in range(1 + int(time_s) % 5)]
        size = len(values)
        return struct.pack(f">BHH{size}H", READ_FIFO, 2 + 2 * size, size, *values)


def bare(unit: int) -> Callable[[Exchange, list[Answer]], list[Answer]]:
    """The answers of a unit without their last two bytes."""

    def cut(exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        if exchange.unit != unit:
            return answers
        return [Answer(answers[0].data[:-2], answers[0].delay_s)]

    return cut


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("is_alone", [True, False])
@pytest.mark.parametrize("function", [3, READ_FIFO])
def test_all_answers_without_a_checksum_are_counted(
    seed: int, is_alone: bool, function: int, tmp_path: Path
) -> None:
    rng = Random(seed)
    units = [WithQueue(unit, {3: {place: smooth(rng) for place in range(20)}}) for unit in (5, 17)]
    made = Queue if function == READ_FIFO else Poll
    polls = [made(5, function, 4, 3)]
    if not is_alone:
        polls.append(Poll(17, 3, 10, 4))
    scene = Scene(rng, Plant(list(units), polls))
    scene.run(80, Changes(bare(5)))
    found = report(scene, tmp_path)
    [row] = found["diagnoses"]
    asked = sum(exchange.unit == 5 for exchange in scene.masters[0].exchanges)
    assert (row["code"], row["unit"]) == ("wrong_layout", 5)
    # The recording ends with the last one, which may be cut.
    assert asked - 1 <= row["failed"] <= row["total"] <= asked
    assert "the two bytes of its checksum" in row["sentence"]
    assert found["verdict"] != "healthy"
