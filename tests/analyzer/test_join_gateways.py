"""A real gateway of pymodbus, joined; mbusd and modbus-proxy: `tests.support.gateways`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from tests.support.gateways import is_clean, score, score_faults
from tests.support.hostile_proxy import KINDS

pytestmark = pytest.mark.filterwarnings("ignore")


Found = TypeVar("Found")


def played(folder: Path, play: Callable[[Path], Found]) -> Found:
    """What is found; played again where the machine was so busy that the gateway gave up."""
    for number in range(4):
        place = folder / str(number)
        place.mkdir()
        found = play(place)
        if is_clean(place):
            break
    return found


def test_a_gateway_of_pymodbus_is_matched(tmp_path: Path) -> None:
    found = played(tmp_path, lambda folder: score("pymodbus", folder, seconds=4))
    assert found.line > 50
    assert found.matched >= 0.99 * found.line
    assert found.wrong == 0
    assert found.has_true_clocks, found.said


def test_what_a_hostile_program_does_is_named(tmp_path: Path) -> None:
    found = played(tmp_path, lambda folder: score_faults("pymodbus", folder, faults=2))
    assert set(found) == {"forwarded", "gateway_timeout", *KINDS}
    for kind, (planted, named) in found.items():
        assert named == planted >= 2, (kind, found)
