"""What is marked as wrong, and in which words."""

from __future__ import annotations

import pytest

from dissectors.describe import describe
from dissectors.table import Direction


@pytest.mark.parametrize(
    ("pdu", "direction", "request_pdu", "name", "said"),
    [
        ("03 006B 007E", "request", None, "quantity", "permits 1 to 125"),
        ("03 006B 0000", "request", None, "quantity", "0 registers; the specification"),
        ("03 FFFF 0002", "request", None, "quantity", "from 465536; reaches beyond address 65535"),
        ("05 0001 0001", "request", None, "value", "permits 0x0000 or 0xFF00"),
        ("14 07 05 0004 0001 0002", "request", None, "groups[0].reference_type", "permits 0x06"),
        ("10 0001 0002 02 000A", "request", None, "byte_count", "but a quantity of 2 takes 4"),
        ("0F 0001 0009 01 00", "request", None, "byte_count", "but a quantity of 9 takes 2"),
        ("03 02 000A", "response", "03 006B 0002", "byte_count", "but a quantity of 2 takes 4"),
        ("03 06 000A", "response", None, "byte_count", "says 6 bytes, but 2 follow; too few"),
        ("03 02 000A 0B", "response", None, "byte_count", "says 2 bytes, but 3 follow; too many"),
        ("03 02 000A 0B", "response", None, "extra", "extra bytes, not part"),
        ("03 06 000A", "response", None, "missing", "missing"),
        ("03 04 000A 0B", "response", None, "extra", "other bytes are missing"),
        ("83 02 00", "response", None, "extra", "only one byte"),
        ("06 0001 0003", "response", "06 0002 0003", "address", "should repeat the request's 2"),
        ("06 0001 0003", "response", "06 0001 0004", "value", "should repeat the request's 4"),
        ("01 01 0F", "response", "01 0000 0003", "coils[0]", "5 padding bits that should be 0"),
        ("08 0004 0000", "response", None, "function", "has no response"),
    ],
)  # fmt: skip
def test_wrong_fields_say_what_is_wrong(
    pdu: str, direction: Direction, request_pdu: str | None, name: str, said: str
) -> None:
    """The block is not sound, and its meaning has the reason."""
    asked = None if request_pdu is None else bytes.fromhex(request_pdu)
    pieces = describe(bytes.fromhex(pdu), mode="pdu", direction=direction, request=asked)
    piece = next(piece for piece in pieces if piece.name == name)
    assert said in piece.meaning
    assert not piece.is_valid


def test_a_request_of_another_function_says_nothing() -> None:
    """No echo is expected from a request that this PDU does not answer."""
    pieces = describe(
        bytes.fromhex("06 0001 0003"),
        mode="pdu",
        direction="response",
        request=bytes.fromhex("05 0002 FF00"),
    )
    assert all(piece.is_valid for piece in pieces)
