"""Addresses in Modicon's notation."""

from __future__ import annotations

import pytest

from dissectors.address import five_digit, modicon_address, six_digit


@pytest.mark.parametrize(
    ("address", "kind", "short", "long"),
    [
        (0, "coil", "00001", "000001"),
        (19, "coil", "00020", "000020"),
        (196, "discrete_input", "10197", "100197"),
        (8, "input_register", "30009", "300009"),
        (107, "holding_register", "40108", "400108"),
        (9998, "holding_register", "49999", "409999"),
        (9999, "holding_register", None, "410000"),
        (65535, "holding_register", None, "465536"),
    ],
)
def test_both_notations(address: int, kind: str, short: str | None, long: str) -> None:
    """The short one ends at 9999; numbers are one more than on the wire."""
    assert five_digit(address, kind) == short
    assert six_digit(address, kind) == long
    assert modicon_address(address, kind) == (long if short is None else f"{long} ({short})")
