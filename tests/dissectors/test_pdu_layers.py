"""scapy's classes for PDUs."""

from __future__ import annotations

import pytest

from dissectors import pdu_layers
from dissectors.pdu_layers import class_for, pdu_class, pdu_classes


def test_every_row_gives_its_classes() -> None:
    """Named after the function, or after the sub-function where a row has its own."""
    names = set(pdu_classes())
    assert {
        "ReadCoilsRequest",
        "ReadCoilsResponse",
        "ReadWriteMultipleRegistersRequest",
        "ReturnQueryDataResponse",
        "ForceListenOnlyModeRequest",
        "DiagnosticsRequest",
        "CANopenGeneralReferenceRequest",
    } <= names
    assert "ForceListenOnlyModeResponse" not in names
    assert not any(name.startswith("SchneiderUMAS") for name in names)


def test_classes_by_code_and_by_name() -> None:
    """The general row answers for sub-functions without their own."""
    assert pdu_class(8, "request", when=4).__name__ == "ForceListenOnlyModeRequest"
    assert pdu_class(8, "request", when=11).__name__ == "DiagnosticsRequest"
    assert pdu_class("Read Coils", "response").__name__ == "ReadCoilsResponse"
    with pytest.raises(KeyError):
        pdu_class(99, "request")


def test_new_packets_are_permitted_ones() -> None:
    """Defaults are within the limits, and the leading field is the row's."""
    assert bytes(pdu_class(3, "request")()) == bytes.fromhex("03 0000 0001")
    assert bytes(pdu_class(43, "request", when=14)()) == bytes.fromhex("2B 0E 01 00")
    assert pdu_class(21, "request")(groups=[{}]).groups[0].reference_type == 6


def test_numbers_have_names() -> None:
    """`show()` prints them, and they can be set by name."""
    packet = pdu_class(8, "request")(sub_function="Return Bus Message Count")
    assert bytes(packet) == bytes.fromhex("08 000B 0000")
    assert "Return Bus Message Count" in str(packet.show(dump=True))


def test_bytes_find_their_class() -> None:
    """By code, leading field and direction; none for what has no layout."""
    found = class_for(bytes.fromhex("08 0000 A537"), "request")
    assert found is not None
    assert found.__name__ == "ReturnQueryDataRequest"
    assert class_for(b"\x83\x02", None) is pdu_layers.ModbusExceptionResponse
    assert class_for(b"\x63", "request") is None
    assert class_for(b"\x5a\x00", "request") is None


def test_the_lists_of_two_packets_are_two_lists() -> None:
    """Two packets do not share the list that is a field's default."""
    one, other = (pdu_class(16, "request")() for _ in range(2))
    one.registers.append(1)
    assert other.registers == []
