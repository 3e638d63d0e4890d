"""One table, three readers: scapy's layers, the core's decoder and its encoder agree."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scapy.packet import Packet, Raw

from dissectors import layers, table, vocabulary
from dissectors.craft import craft_pdu
from dissectors.describe import describe
from dissectors.table import Direction, Function, row_of
from tests.border.rows import ALL_FUNCTIONS, CASES, ROWS, case_id, decoded, encoded, plain, values

FRAMES: dict[tuple[str, Direction], type[Packet]] = {
    ("rtu", "request"): layers.ModbusRTURequest,
    ("rtu", "response"): layers.ModbusRTUResponse,
    ("ascii", "request"): layers.ModbusASCIIRequest,
    ("ascii", "response"): layers.ModbusASCIIResponse,
    ("tcp", "request"): layers.ModbusTCPRequest,
    ("tcp", "response"): layers.ModbusTCPResponse,
}


@pytest.fixture(scope="module", autouse=True)
def _vendors() -> None:
    for vendor in vocabulary.vendors():
        layers.load_vendor(vendor)


def built(row: Function, direction: Direction, given: dict[str, Any]) -> Packet:
    """Return scapy's packet of these values."""
    when = row.when[1] if row.when else None
    return layers.pdu_class(row.code, direction, when=when)(**given)


def same(given: Any, read: Any) -> bool:
    """Whether everything given was read; bits come back padded to whole bytes, with zeros."""
    if isinstance(given, dict):
        return all(same(value, read[name]) for name, value in given.items())
    if isinstance(given, list) and len(given) < len(read) and set(given) <= {0, 1}:
        return bool(read[: len(given)] == given and not any(read[len(given) :]))
    if isinstance(given, list):
        return len(given) == len(read) and all(map(same, given, read))
    return bool(given == read)


def of_packet(packet: Packet) -> dict[str, Any]:
    """Return a packet's fields as plain values."""
    found = {}
    for name, value in packet.fields.items():
        items = value if isinstance(value, list) else None
        groups = items is not None and any(isinstance(item, Packet) for item in items)
        found[name] = [of_packet(item) for item in items or ()] if groups else plain(value)
    return found


@pytest.mark.parametrize(("row", "direction"), CASES, ids=case_id)
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_scapy_builds_what_the_core_reads_and_writes(
    row: Function, direction: Direction, data: st.DataObject
) -> None:
    """The same values give the same bytes on both sides, and the core reads them back."""
    wanted = data.draw(values(row, direction))
    pdu = bytes(built(row, direction, wanted))
    assert encoded(row.code, direction, wanted) == pdu
    read = decoded(pdu, direction)
    assert read["complete"]
    assert "extra" not in read["fields"]
    assert same(plain(wanted), read["fields"])
    assert read["name"] == row.name


@pytest.mark.parametrize(("row", "direction"), CASES, ids=case_id)
@pytest.mark.parametrize("mode", ["rtu", "ascii", "tcp"])
@settings(max_examples=10, deadline=None)
@given(data=st.data())
def test_scapy_reads_back_what_it_builds(
    mode: str, row: Function, direction: Direction, data: st.DataObject
) -> None:
    """A frame read from its own bytes has the same fields, no rest, and gives the bytes again."""
    wanted = data.draw(values(row, direction))
    cls = FRAMES[mode, direction]
    frame = bytes(cls(unit=data.draw(st.integers(0, 255))) / built(row, direction, wanted))
    again = cls(frame)
    assert bytes(again) == frame
    assert not again.haslayer(Raw)
    assert type(again.payload) is type(built(row, direction, {}))
    assert same(plain(wanted), of_packet(again.payload))


@pytest.mark.parametrize(("row", "direction"), CASES, ids=case_id)
def test_every_example_decodes_completely_and_comes_back(
    row: Function, direction: Direction
) -> None:
    """The core reads an example to its last byte; core, craft and scapy write it again."""
    example = row.example_request if direction == "request" else row.example_response
    assert example is not None
    pieces = describe(example, mode="pdu", direction=direction, functions=ALL_FUNCTIONS)
    assert all(piece.is_valid for piece in pieces)
    assert row_of(example, source=ALL_FUNCTIONS) == row
    fields = decoded(example, direction)["fields"]
    assert encoded(row.code, direction, fields) == example
    given = {name: value for name, value in fields.items() if not isinstance(value, dict)}
    assert (
        craft_pdu(row.code, direction=direction, values=given, functions=ALL_FUNCTIONS) == example
    )
    frame = FRAMES["tcp", direction](bytes(layers.ModbusTCP() / Raw(example)))
    assert not frame.haslayer(Raw)
    assert bytes(frame.payload) == example


@pytest.mark.parametrize("row", ROWS, ids=case_id)
def test_every_row_has_an_example_of_both_directions(row: Function) -> None:
    """A row whose response exists shows one; the code is the row's."""
    assert row.example_request[:1] == bytes([row.code])
    assert (row.example_response is None) == (not row.has_response)
    if row.example_response is not None:
        assert row.example_response[:1] == bytes([row.code])


@pytest.mark.parametrize("row", ROWS, ids=case_id)
def test_rows_speak_of_fields_that_they_have(row: Function) -> None:
    """Echoes, limits and allowed values name fields of the row, of a group or of the body."""
    names = {
        name
        for field in (*row.fields("request"), *row.fields("response"))
        for name in (field.name, *(child.name for child in field.children))
    }
    assert set(row.echo) <= {field.name for field in row.fields("response")}
    assert set(row.limits) | set(row.allowed) <= names


def test_the_public_functions_are_all_there() -> None:
    """The 19 public functions (section 5.1), and no name twice."""
    public = {1, 2, 3, 4, 5, 6, 7, 8, 11, 12, 15, 16, 17, 20, 21, 22, 23, 24, 43}
    assert public <= {row.code for row in table.functions()}
    labels = [row.label for row in ROWS]
    assert len(labels) == len(set(labels))
