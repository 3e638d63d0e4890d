"""Bytes beside meaning: frames of every mode, whole and damaged."""

from __future__ import annotations

from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import _modlens
from dissectors.describe import Mode, Piece, describe

MODES: tuple[Mode, ...] = ("rtu", "ascii", "tcp", "pdu")


def by_name(pieces: list[Piece]) -> dict[str, Piece]:
    """Return the blocks by their names."""
    return {piece.name: piece for piece in pieces}


def assert_tiled(pieces: list[Piece], data: bytes) -> None:
    """Joined, the blocks are the frame."""
    at = 0
    for piece in pieces:
        assert piece.offset == at
        at += len(piece.data)
    assert b"".join(piece.data for piece in pieces) == data


@settings(deadline=None)
@given(
    data=st.binary(max_size=260),
    mode=st.sampled_from(MODES),
    direction=st.sampled_from(["request", "response", "unknown"]),
    has_checksum=st.booleans(),
    request=st.none() | st.binary(max_size=12),
)
def test_any_bytes_are_tiled(
    data: bytes,
    mode: Mode,
    direction: Literal["request", "response", "unknown"],
    has_checksum: bool,
    request: bytes | None,
) -> None:
    """Whatever the bytes are, nothing raises and nothing is lost."""
    pieces = describe(
        data, mode=mode, direction=direction, has_checksum=has_checksum, request=request
    )
    assert_tiled(pieces, data)


@settings(deadline=None)
@given(pdu=st.binary(min_size=1, max_size=250), lower=st.booleans())
def test_ascii_offsets_are_characters(pdu: bytes, lower: bool) -> None:
    """A byte is two characters on the wire, in capitals or not."""
    binary = b"\x01" + pdu
    digits = (binary + bytes([_modlens.lrc(binary)])).hex()
    text = b":" + (digits if lower else digits.upper()).encode() + b"\r\n"
    pieces = describe(text, mode="ascii")
    assert_tiled(pieces, text)
    assert by_name(pieces)["checksum"].is_valid


def test_rtu_checksum_expected_and_found() -> None:
    """The CRC is described as right, wrong, or absent."""
    frame = bytes.fromhex("11 03 006B 0003 7687")
    right = by_name(describe(frame, mode="rtu"))["checksum"]
    assert (right.meaning, right.layer, right.is_valid) == ("CRC OK", "checksum", True)
    wrong = by_name(describe(frame[:-1] + b"\x88", mode="rtu"))["checksum"]
    assert wrong.meaning == "CRC error: 0x8776 expected, 0x8876 found"
    assert not wrong.is_valid
    bare = describe(frame[:-2], mode="rtu", has_checksum=False)
    assert [piece.name for piece in bare] == ["unit", "function", "address", "quantity"]
    assert_tiled(bare, frame[:-2])


def test_units_on_serial_lines_and_on_tcp() -> None:
    """Broadcast and reserved numbers are serial notions."""
    serial = describe(bytes.fromhex("00 07 0000"), mode="rtu")[0]
    assert serial.meaning.startswith("broadcast")
    assert not describe(bytes.fromhex("F8 07 0000"), mode="rtu")[0].is_valid
    unit = by_name(describe(bytes.fromhex("0001 0000 0002 FF 07"), mode="tcp"))["unit"]
    assert (unit.meaning, unit.layer, unit.is_valid) == ("unit 255", "mbap", True)


def test_mbap_fields() -> None:
    """Identifiers and length; what is beyond the length is apart."""
    frame = bytes.fromhex("0102 0001 0003 11 076D FF")
    found = by_name(describe(frame, mode="tcp", direction="response"))
    assert found["mbap_id"].value == "258"
    assert "must be 0" in found["protocol"].meaning
    assert found["length"].meaning == "the length field says 3, but 4 bytes follow"
    assert found["extra"].data == b"\xff"
    assert not any(found[name].is_valid for name in ("protocol", "length", "extra"))


@pytest.mark.parametrize(
    ("data", "mode"),
    [
        (b"\x01\x03", "rtu"),
        (b"", "rtu"),
        (b"\x00\x01\x00", "tcp"),
        (b":01\r\n", "ascii"),
        (b":0x03FB\r\n", "ascii"),
        (b"0103FC\r\n", "ascii"),
    ],
)
def test_what_cannot_be_a_frame_is_one_piece_of_noise(data: bytes, mode: Mode) -> None:
    """What cannot be a frame is one block of noise, with the reason."""
    (piece,) = describe(data, mode=mode)
    assert (piece.name, piece.data, piece.is_valid) == ("noise", data, False)
    assert piece.meaning


def test_ascii_without_its_end() -> None:
    """The end of an ASCII frame is invalid where it is not CR LF."""
    frame = b":0107F8"
    for tail, shown in ((b"\n", "LF"), (b"", ""), (b"\r", "CR")):
        last = describe(frame + tail, mode="ascii")[-1]
        assert (last.name, last.value, last.is_valid) == ("end", shown, False)


def test_a_frame_of_a_header_only() -> None:
    """The function code is missing, and that is said."""
    pieces = describe(bytes.fromhex("0001 0000 0001 11"), mode="tcp")
    assert (pieces[-1].name, pieces[-1].data, pieces[-1].is_valid) == ("function", b"", False)


def test_direction_unknown_is_settled_by_layout() -> None:
    """Responses are recognised; what fits both is read as a request."""
    response = describe(bytes.fromhex("03 02 0064"), mode="pdu")
    assert response[0].meaning == "Read Holding Registers, response by its layout"
    either = describe(bytes.fromhex("06 0001 0003"), mode="pdu")
    assert either[0].meaning == "Write Single Register, request by its layout"


def test_vendors_functions_are_described() -> None:
    """Vendors' functions are described when their rows are given."""
    table = _modlens.Functions()
    table.load_vendor("huawei")
    pieces = describe(
        bytes.fromhex("41 24 01 00"), mode="pdu", direction="request", functions=table
    )
    assert pieces[0].meaning == "Huawei Private Function (Login Challenge), request"
    assert [piece.name for piece in pieces] == ["function", "sub_function", "byte_count", "value"]


def test_the_last_bytes_of_a_cut_off_frame_are_no_checksum() -> None:
    """Four bytes of a read request of eight: the last two are its address."""
    pieces = describe(bytes.fromhex("01 03 00 6B"), mode="rtu")
    assert [(piece.name, piece.data.hex()) for piece in pieces][-2:] == [
        ("missing", ""),
        ("cut off", "006b"),
    ]


def test_fields_of_groups_have_their_path() -> None:
    """An object of Read Device Identification: its id, its length, its text."""
    pieces = describe(
        bytes.fromhex("2B 0E 01 01 00 00 01 00 05 48656C6C6F"), mode="pdu", direction="response"
    )
    assert pieces[0].meaning.startswith("Encapsulated Interface Transport (Read Device Ident")
    assert [(piece.name, piece.offset, piece.value) for piece in pieces[-3:]] == [
        ("objects[0].object_id", 7, "0"),
        ("objects[0].length", 8, "5"),
        ("objects[0].value", 9, "48 65 6c 6c 6f"),
    ]


def test_a_sub_function_that_is_cut_off_has_no_name() -> None:
    """One byte of two does not say which of the sub-functions of Diagnostics it is."""
    cut, whole = (describe(bytes.fromhex(pdu), mode="pdu")[0] for pdu in ("08 04", "08 0004"))
    assert cut.meaning.startswith("Diagnostics, ")
    assert whole.meaning.startswith("Diagnostics (Force Listen Only Mode), ")


def test_an_object_id_of_a_range_has_the_name_of_the_range() -> None:
    """Objects from 0x80 on are private (application protocol, 6.21)."""
    pdu = bytes.fromhex("2B 0E 04 83 00 00 01 85 02 4869")
    found = by_name(describe(pdu, mode="pdu", direction="response"))
    assert found["objects[0].object_id"].meaning == "Private"
