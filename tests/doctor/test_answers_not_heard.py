"""Answers that come after the master has stopped waiting for them, and before its next request.

The line shows each of them as the good answer to its request. That the master does not wait for
them shows in its next requests, which go by its timeout there and by the answer otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from random import Random

import pytest

from analyzer import decode
from tests.doctor.line_model import Trouble
from tests.doctor.plant import Plant, Unit, random_plant
from tests.doctor.scene import Scene
from tests.doctor.tcp_model import Site
from tests.doctor.test_evidence_of_lines import Report, report
from tests.doctor.test_signs_of_senders import said

SEEDS = (31, 32, 33, 34)


@dataclass(slots=True)
class Busy(Unit):
    """A unit that is busy at a share of its requests, and answers then in a time of this range."""

    share: float = 0.0
    busy_s: tuple[float, float] = (0.0, 0.0)

    def delay(self, rng: Random) -> float:
        """Soon, or when it has time."""
        return rng.uniform(*self.busy_s) if rng.random() < self.share else rng.uniform(0.004, 0.009)


def made_busy(plant: Plant, rng: Random, share: float, busy_s: tuple[float, float]) -> int:
    """Make a unit of the plant busy at times; its address."""
    at = rng.randrange(len(plant.units))
    unit = plant.units[at]
    made = Busy(unit.address, unit.tables, share=share, busy_s=busy_s)
    plant.units[at] = plant.by_address[unit.address] = made
    return unit.address


def line(rng: Random, timeout_s: float, share: float) -> tuple[Scene, int]:
    """A unit answers some requests late; the master pauses for longer than that."""
    scene = Scene(rng, random_plant(rng, units=rng.randint(1, 3)))
    habits = scene.habits
    habits.timeout_s, habits.retries, habits.period_s = timeout_s, rng.randint(0, 2), 0.0
    habits.pauses_s = (rng.uniform(0.4, 1.0),)
    busy_s = (timeout_s * 0.7, timeout_s + habits.pauses_s[0] * 0.7)
    return scene, made_busy(scene.plant, rng, share, busy_s)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("share", [0.08, 0.5])
def test_a_master_that_does_not_wait_for_an_answer_goes_on_by_its_timeout(
    seed: int, share: float, tmp_path: Path
) -> None:
    rng = Random(seed)
    scene, unit = line(rng, rng.choice([0.2, 0.3, 0.5]), share)
    scene.run(500)
    found = report(scene, tmp_path)
    assert said(found) == [("slow_answers", unit)]
    row = found["diagnoses"][0]
    late = [
        exchange
        for exchange in scene.masters[0].exchanges
        if exchange.unit == unit and exchange.outcome != "ok"
    ]
    assert abs(row["failed"] - len(late)) <= max(2, len(late) // 10)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("share", [0.08, 0.5])
def test_a_master_that_waits_for_each_answer_has_heard_all(
    seed: int, share: float, tmp_path: Path
) -> None:
    """The same times, and a timeout that no answer reaches: with a pause, or in a fixed cycle."""
    rng = Random(seed)
    scene, _ = line(rng, 0.3, share)
    scene.habits.timeout_s = 3.0
    if seed % 2:
        scene.habits.period_s, scene.habits.pauses_s = rng.choice([1.0, 2.0, 5.0]), (0.02,)
    scene.run(500, Trouble())
    found = report(scene, tmp_path)
    assert (found["verdict"], said(found)) == ("healthy", [])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("timeout_s", [0.3, 3.0])
def test_a_client_that_keeps_its_connection_may_not_wait_either(
    seed: int, timeout_s: float, tmp_path: Path
) -> None:
    rng = Random(seed)
    site = Site(rng, units=2)
    unit = made_busy(site.plant, rng, 0.2, (0.2, 0.7))
    client = site.client(0)
    client.timeout_s, client.pause_s, client.period_s = timeout_s, rng.uniform(0.5, 0.9), 0.0
    client.run(400)
    path = tmp_path / "net.pcap"
    path.write_bytes(site.network.pcap())
    found: Report = decode(path).doctor()
    assert said(found) == ([("slow_answers", unit)] if timeout_s < 1 else [])
