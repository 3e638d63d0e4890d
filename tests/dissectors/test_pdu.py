"""PDUs taken apart, and the direction that layout suggests."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissectors.pdu import decode, guess_direction


def test_paths_say_where_in_a_group_a_field_is() -> None:
    """Groups are flattened; offsets count from the function code."""
    pdu = decode(bytes.fromhex("2B 0E 01 01 00 00 01 00 05 48656C6C6F"), "response")
    assert pdu.row is not None
    assert pdu.row.label == "Read Device Identification"
    assert [(part.path, part.offset, part.value) for part in pdu.fields[-3:]] == [
        ("objects[0].object_id", 7, 0),
        ("objects[0].length", 8, 5),
        ("objects[0].value", 9, b"Hello"),
    ]
    assert pdu.numbers["number_of_objects"] == 1


def test_values_have_the_types_of_their_words() -> None:
    """Bits are 0 and 1, registers numbers, text bytes."""
    assert decode(bytes.fromhex("01 01 05"), "response").fields[1].value == (1, 0, 1, 0, 0, 0, 0, 0)
    assert decode(bytes.fromhex("03 02 0102"), "response").fields[1].value == (258,)
    assert decode(bytes.fromhex("11 02 41FF"), "response").fields[1].value == b"A\xff"


@pytest.mark.parametrize(
    ("pdu", "direction"),
    [
        ("03 006B 0003", "request"),
        ("03 06 022B 0000 0064", "response"),
        ("83 02", "response"),
        ("10 0001 0002 04 000A 0102", "request"),
        ("10 0001 0002", "response"),
        ("06 0001 0003", "unknown"),
        ("05 0001 1234", "unknown"),
        ("07", "request"),
        ("07 6D", "response"),
        ("08 0004 0000", "request"),
        ("03 FFFF", "unknown"),
        ("63 0102", "unknown"),
        ("", "unknown"),
    ],
)
def test_layout_tells_the_direction_where_it_can(pdu: str, direction: str) -> None:
    """Quantities out of limits count against a request."""
    assert guess_direction(bytes.fromhex(pdu)) == direction


@settings(deadline=None)
@given(st.binary(max_size=260))
def test_any_bytes_can_be_guessed(pdu: bytes) -> None:
    """The direction of any bytes can be inferred without an error."""
    assert guess_direction(pdu) in {"request", "response", "unknown"}


def test_damage_is_data() -> None:
    """An empty PDU and an unknown function decode too."""
    empty = decode(b"", "request")
    assert (empty.row, empty.complete, empty.fields) == (None, False, ())
    unknown = decode(bytes.fromhex("63 0102"), "request")
    assert unknown.row is None
    assert unknown.fields[0].name == "extra"
