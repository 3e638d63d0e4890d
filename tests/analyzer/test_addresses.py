"""Addresses as people write them, both ways."""

from __future__ import annotations

import pytest

from analyzer.addresses import Address, parse, register_type, render


@pytest.mark.parametrize(
    ("text", "kind", "wire"),
    [
        ("40108", "holding_register", 107),
        ("400108", "holding_register", 107),
        ("465536", "holding_register", 65535),
        ("4x006B", "holding_register", 107),
        ("4x6b", "holding_register", 107),
        ("30001", "input_register", 0),
        ("10197", "discrete_input", 196),
        ("00020", "coil", 19),
        ("000020", "coil", 19),
        ("0xFFFF", "coil", 65535),
    ],
)
def test_a_literal_says_type_and_address(text: str, kind: str, wire: int) -> None:
    """Handbooks count from 1, hex is the wire address."""
    assert parse(text) == Address(kind, wire)


@pytest.mark.parametrize(
    "text", ["", "107", "40000", "400000", "465537", "20001", "4x", "4xG", "-40001"]
)
def test_other_texts_are_no_literals(text: str) -> None:
    """Zero does not exist where one counts from 1, nor does the type 2."""
    assert parse(text) is None


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


@pytest.mark.parametrize(
    ("name", "kind"),
    [("hr", "holding_register"), ("di", "discrete_input"), ("coil", "coil"), ("xx", None)],
)
def test_register_types_have_short_and_full_names(name: str, kind: str | None) -> None:
    """Short and full names of register types are accepted."""
    assert register_type(name) == kind
