"""A unit whose program builds its answers wrongly: a right checksum, in another layout."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from tests.doctor.case import Case, kind, scale
from tests.doctor.frames import rtu
from tests.doctor.kinds.silences import share_of
from tests.doctor.line_model import Answer, Exchange, Trouble
from tests.doctor.plant import random_plant
from tests.doctor.scene import Scene

FAULTS = ("no count", "wide count", "counts registers")


def built_wrongly(answer: bytes, fault: str) -> bytes:
    """An answer to a read (application protocol, 6.1 to 6.4), built with this fault."""
    unit, head, data = answer[0], answer[1:2], answer[3:-2]
    match fault:
        case "no count":
            return rtu(unit, head + data)
        case "wide count":
            return rtu(unit, head + len(data).to_bytes(2, "big") + data)
        case _:
            return rtu(unit, head + bytes([len(data) // 2]) + data)


class BuiltWrongly(Trouble):
    """One unit, from the first answer to the last; refusals are as they should be."""

    def __init__(self, unit: int, fault: str) -> None:
        self.unit, self.fault = unit, fault

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """In the wrong layout."""
        if not answers or exchange.unit != self.unit or answers[0].data[1] not in (3, 4):
            return answers
        exchange.struck = True
        wrong = built_wrongly(answers[0].data, self.fault)
        return [replace(answers[0], data=wrong, right=False)]


@kind("wrong_layout")
def wrong_layout(rng: Random, seed: int) -> Case:
    """All answers of one unit lack the byte count, or have a wrong one."""
    scene = Scene(rng, random_plant(rng, functions=(3, 4)))
    unit = rng.choice(scene.plant.units).address
    count, _ = scale(rng, share_of(scene.plant, unit))
    scene.run(count, BuiltWrongly(unit, FAULTS[seed % len(FAULTS)]))
    forbidden = frozenset({"duplicate_address", "line_noise", "driver_enable", "two_masters"})
    return scene.case("wrong_layout", unit=unit, forbidden=forbidden)
