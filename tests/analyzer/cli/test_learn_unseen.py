"""`modlens learn` on randomly generated devices, one for each seed.

Nine of ten of all values of several registers have to be found with type and order, those among
them whose registers the recording alone does not show to be one (`RandomDevice.decidable`: every
fifth) too; of all claims, one of twenty may be wrong.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from pathlib import Path

from tests.conftest import CAPTURES, Modlens
from tests.support.random_devices import RandomDevice

SEEDS = range(201, 217)

RECORDED = 303
"""The seed of the device in `captures/pymodbus_plant`."""


def count(plant: RandomDevice, toml: str) -> Counter[str]:
    """Values, claims, right and wrong ones."""
    claims = {}
    for point in tomllib.loads(toml)["registers"]:
        kind = point.get("type", "u16")
        if kind not in ("u16", "s16"):
            claims[int(point["at"].removeprefix("hr:"))] = (kind, point.get("order", "ABCD"))
    truth = {at: (item.kind, item.order) for at, item in plant.items.items() if item.wide}
    right = {at for at, claim in claims.items() if truth.get(at) == claim}
    shown = {at for at in truth if plant.decidable(at)}
    return Counter(
        all=len(truth), right=len(right), shown=len(shown), found=len(right & shown),
        claims=len(claims), wrong=len(claims) - len(right),
    )  # fmt: skip


def test_devices_that_chance_has_made(tmp_path: Path, modlens: Modlens) -> None:
    """The traffic is framed by pymodbus."""
    total: Counter[str] = Counter()
    for seed in SEEDS:
        plant = RandomDevice(seed)
        path = tmp_path / f"{seed}.hex"
        path.write_text(plant.recording())
        done = modlens("learn", str(path))
        assert done.status == 0
        total += count(plant, done.out)
    assert total["shown"] > 300
    assert total["right"] >= 0.9 * total["all"], total
    assert total["found"] >= 0.95 * total["shown"], total
    assert total["wrong"] <= 0.05 * total["claims"], total


def test_one_of_them_on_a_line(modlens: Modlens) -> None:
    """Recorded from pymodbus' client and server on a paced pty bus."""
    path = CAPTURES / "pymodbus_plant" / "recording.jsonl"
    found = count(RandomDevice(RECORDED), modlens("learn", str(path), "--line", "57600-8E1").out)
    assert found["right"] >= 0.9 * found["all"], found
    assert found["found"] >= 0.9 * found["shown"], found
    assert found["wrong"] <= 2, found
