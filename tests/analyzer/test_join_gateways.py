"""A real gateway of pymodbus, joined; mbusd and modbus-proxy: `tests.support.gateways`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.gateways import score, score_faults
from tests.support.hostile_proxy import KINDS

pytestmark = pytest.mark.filterwarnings("ignore")


def test_a_gateway_of_pymodbus_is_matched(tmp_path: Path) -> None:
    found = score("pymodbus", tmp_path, seconds=4)
    assert found.line > 50
    assert found.matched >= 0.99 * found.line
    assert found.wrong == 0
    assert found.has_true_clocks, found.said


def test_what_a_hostile_program_does_is_named(tmp_path: Path) -> None:
    found = score_faults("pymodbus", tmp_path, faults=2)
    assert set(found) == {"forwarded", "gateway_timeout", *KINDS}
    for kind, (planted, named) in found.items():
        assert named == planted >= 2, (kind, found)
