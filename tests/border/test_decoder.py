"""The core's decoder at its edges: damage, exceptions, and every byte accounted for."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import _modlens
from dissectors import vocabulary
from dissectors.describe import describe
from dissectors.pdu import default_functions, guess_direction
from dissectors.table import DIRECTIONS, Direction, Function
from tests.border.rows import ALL_FUNCTIONS, CASES, case_id, encoded, values


def tree(pdu: bytes, direction: Direction) -> dict[str, Any]:
    """Return the core's reading."""
    return dict(json.loads(ALL_FUNCTIONS.decode(pdu, direction)))


@settings(max_examples=500, deadline=None)
@given(pdu=st.binary(max_size=260), direction=st.sampled_from(DIRECTIONS))
def test_any_bytes_decode_and_every_byte_stands_in_one_field(
    pdu: bytes, direction: Direction
) -> None:
    """Fields tile the body, in order, whatever the bytes are."""
    read = tree(pdu, direction)
    at = 1
    for field in read["fields"]:
        assert field["offset"] == at
        at += field["length"]
    assert at == max(1, len(pdu))
    assert not pdu or read["function"] == pdu[0] & 0x7F


@pytest.mark.parametrize(("row", "direction"), CASES, ids=case_id)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_a_cut_pdu_is_incomplete_and_a_longer_one_has_extra(
    row: Function, direction: Direction, data: st.DataObject
) -> None:
    """Unless the layout is open at its end, one byte less and one byte more are noticed."""
    wanted = data.draw(values(row, direction))
    pdu = encoded(row.code, direction, wanted)
    words = [field.field_type for field in row.fields(direction)]
    open_end = bool(words) and words[-1] in ("bytes",) and not any(w[:3] == "len" for w in words)
    if open_end or len(pdu) == 1:
        return
    short, long = (tree(body, direction) for body in (pdu[:-1], pdu + b"\0"))
    assert not short["complete"] or short["fields"][-1]["name"] == "extra"
    assert long["fields"][-1]["name"] == "extra"
    assert long["complete"]


@pytest.mark.parametrize("code", [entry.code for entry in vocabulary.names("exceptions")])
@settings(max_examples=30, deadline=None)
@given(function=st.integers(1, 127))
def test_exceptions_of_every_function_decode(code: int, function: int) -> None:
    """The function comes without its exception bit, known or not."""
    read = tree(bytes([function | 0x80, code]), "response")
    assert read["function"] == function
    assert read["exception"] == code
    assert read["complete"]
    assert encoded(function, "response", {"exception_code": code}) == bytes([function | 0x80, code])


def test_a_bare_exception_bit_is_incomplete() -> None:
    """An exception response without a code is incomplete."""
    assert not tree(b"\x83", "response")["complete"]
    assert tree(b"\x83", "response")["exception"] is None


def test_groups_that_do_not_advance_end() -> None:
    """Half an item at the end of a group list must not hold up the decoder."""
    functions = _modlens.Functions()
    functions.load(
        """
        format = 1
        [[function]]
        code = 0x47
        name = "Pairs"
        section = "vendor"
        summary = "pairs of words"
        request = ["pairs:group{first:u16 second:u16}"]
        response = ["lists:group{items:u16[]}"]
        example = { request = "47 0001 0002", response = "47 0001" }
        """,
        "pairs.toml",
    )
    for direction in DIRECTIONS:
        read = json.loads(functions.decode(bytes.fromhex("47 0001 0002 03"), direction))
        assert read["fields"][-1]["name"] == "extra"


@pytest.mark.parametrize(("row", "direction"), CASES, ids=case_id)
def test_the_example_fits_its_own_direction(row: Function, direction: Direction) -> None:
    """A guess by layout is never the wrong direction."""
    example = row.example_request if direction == "request" else row.example_response
    assert example is not None
    assert guess_direction(example, functions=ALL_FUNCTIONS) in (direction, "unknown")
    pieces = describe(example, mode="pdu", direction=direction, functions=ALL_FUNCTIONS)
    assert all(piece.is_valid for piece in pieces)


def test_vendors_rows_are_not_there_by_default() -> None:
    """0x41 means nothing until Huawei's rows are loaded."""
    assert json.loads(default_functions().decode(b"\x41\x24\x01\x00", "request"))["name"] is None
    assert tree(b"\x41\x24\x01\x00", "request")["name"] == "Huawei Private Function"
