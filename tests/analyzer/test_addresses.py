"""Addresses as people write them."""

from __future__ import annotations

import pytest

from analyzer.addresses import render


@pytest.mark.parametrize(
    ("base", "text"),
    [("wire", "9998"), ("hex", "0x270E"), ("5digit", "49999"), ("6digit", "409999")],
)
def test_an_address_is_shown_in_its_base(base: str, text: str) -> None:
    """The last address that five digits can express, in all notations."""
    assert render(9998, "holding_register", base) == text


def test_five_digits_become_six_above_9999() -> None:
    """Addresses beyond five digits are written in six."""
    assert render(9999, "coil", "5digit") == "010000"


def test_without_a_type_there_is_only_the_wire_address() -> None:
    """Without a register type there is no leading digit, so the wire address is shown."""
    assert render(107, None, "5digit") == "107"
