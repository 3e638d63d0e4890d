"""The direction that layout suggests."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissectors.pdu import guess_direction


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
