"""A real gateway of pymodbus, joined; mbusd and modbus-proxy: `tests.support.gateways`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.gateways import score

pytestmark = pytest.mark.filterwarnings("ignore")


def test_a_gateway_of_pymodbus_is_matched(tmp_path: Path) -> None:
    found = score("pymodbus", tmp_path, seconds=4)
    assert found.line > 50
    assert found.matched >= 0.99 * found.line
    assert found.wrong == 0
