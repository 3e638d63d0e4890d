"""Frames from keywords."""

from __future__ import annotations

from typing import Any, Literal

import pytest

import _modlens
from dissectors.craft import craft, craft_pdu, frame
from dissectors.errors import UsageError


@pytest.mark.parametrize(
    ("function", "values", "pdu"),
    [
        ("Read Coils", {"address": 19, "quantity": "0x13"}, "01 0013 0013"),
        (5, {"address": 172, "value": "on"}, "05 00AC FF00"),
        (5, {"address": 172, "value": False}, "05 00AC 0000"),
        (6, {"address": 1, "value": 3}, "06 0001 0003"),
        (7, {}, "07"),
        (8, {"sub_function": 0, "data": "A537"}, "08 0000 A537"),
        ("Return Query Data", {"data": b"\xa5\x37"}, "08 0000 A537"),
        ("Force Listen Only Mode", {}, "08 0004 0000"),
        (15, {"address": 19, "coils": "1011001110"}, "0F 0013 000A 02 CD01"),
        (16, {"address": 1, "registers": "10,258"}, "10 0001 0002 04 000A 0102"),
        (16, {"address": 1, "quantity": 9, "registers": [10]}, "10 0001 0009 02 000A"),
        (16, {"address": 1, "byte_count": 7, "registers": [10]}, "10 0001 0001 07 000A"),
        (21, {"groups": {"file": 4, "record": 7, "registers": 1}}, "15 09 06 0004 0007 0001 0001"),
        (22, {"address": 4, "and_mask": 0xF2, "or_mask": 0x25}, "16 0004 00F2 0025"),
        (23, {"address": 3, "quantity": 6, "write_address": 14, "write_registers": [255]},
         "17 0003 0006 000E 0001 02 00FF"),
        ("Read Device Identification", {"read_device_id_code": 1, "object_id": 0}, "2B 0E 01 00"),
        (0x5A, {"data": "0002"}, "5A 0002"),
        (99, {"data": b"\x01"}, "63 01"),
    ],
)  # fmt: skip
def test_requests(function: int | str, values: dict[str, Any], pdu: str) -> None:
    """Lengths, counts, quantities and the only permitted values are filled in."""
    assert craft_pdu(function, values=values) == bytes.fromhex(pdu)


def test_responses_and_exceptions() -> None:
    """An exception by code or by name; a bit list becomes bytes."""
    assert craft_pdu(1, direction="response", values={"coils": "1010"}).hex() == "010105"
    for value in (2, "2", "Illegal Data Address", "illegal_data_address"):
        assert craft_pdu(3, direction="response", values={"exception": value}).hex() == "8302"


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("rtu", bytes.fromhex("11 03 006B 0003 7687")),
        ("ascii", b":1103006B00037E\r\n"),
        ("tcp", bytes.fromhex("0007 0000 0006 11 03 006B 0003")),
    ],
)
def test_the_three_framings(mode: Literal["rtu", "ascii", "tcp"], expected: bytes) -> None:
    """RTU has its CRC low byte first, ASCII an LRC and capitals, TCP an MBAP header."""
    made = craft(3, unit=17, mode=mode, values={"address": 107, "quantity": 3}, mbap_id=7)
    assert made == expected


@pytest.mark.parametrize(
    ("function", "values", "said"),
    [
        (3, {"adress": 1, "quantity": 1}, "did you mean 'address'"),
        (3, {"xyzzy": 1}, "it takes address, quantity"),
        (7, {"xyzzy": 1}, "no fields"),
        (3, {"address": 1}, "needs quantity"),
        (23, {"address": 3, "write_address": 14, "write_registers": [1]}, "needs quantity"),
        (3, {"address": 65536, "quantity": 1}, "address takes a number from 0 to 65535"),
        ("Return Query Data", {"sub_function": 1, "data": ""}, "sub_function is 0"),
        (3, {"exception": "ilegal data adress"}, "did you mean 'Illegal Data Address'"),
        (3, {"exception": "xyzzy"}, "a code or a name"),
        (3, {"exception": 256}, "0 to 255"),
        (0x5A, {"address": 1}, "data=HEX"),
        (21, {"groups": [{"file": 4, "registers": [1]}]}, "record"),
        ("Read Coil", {}, "did you mean 'Read Coils'"),
    ],
)
def test_wrong_keywords_say_what_is_right(
    function: int | str, values: dict[str, Any], said: str
) -> None:
    """Unknown names get the nearest one, missing ones are named."""
    with pytest.raises(UsageError, match=said):
        craft(function, values=values)


def test_what_is_never_answered_has_no_response() -> None:
    """Force Listen Only Mode has no response that could be made."""
    with pytest.raises(UsageError, match="has no response"):
        craft("Force Listen Only Mode", direction="response")


def test_units_and_transactions_have_ranges() -> None:
    """Units have one byte, transaction identifiers two."""
    with pytest.raises(UsageError, match="unit must be 0 to 255, not 256"):
        frame(b"\x07", unit=256)
    with pytest.raises(UsageError, match="65536"):
        frame(b"\x07", mbap_id=65536)


def test_vendors_functions() -> None:
    """Vendors' functions can be made by name when their rows are loaded."""
    table = _modlens.Functions()
    table.load_vendor("huawei")
    made = craft_pdu("Login Challenge", values={"value": 0}, functions=table)
    assert made == bytes.fromhex("41 24 01 00")
