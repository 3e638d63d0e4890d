"""Conversion against independent libraries: numpy, pymodbus, struct; and by hand.

Every type in every order, over random bits; not a number, infinities and the edges included.
"""

from __future__ import annotations

import math
import struct
from decimal import Decimal
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.client.mixin import ModbusClientMixin

import _modlens
from tests.support.readings import read_point

ORDERS = ("ABCD", "CDAB", "BADC", "DCBA")
NUMPY = {
    "u16": ">u2", "s16": ">i2", "u32": ">u4", "s32": ">i4", "u64": ">u8", "s64": ">i8",
    "f16": ">f2", "f32": ">f4", "f64": ">f8",
}  # fmt: skip
REGISTERS_OF_TYPE = {kind: np.dtype(code).itemsize for kind, code in NUMPY.items()}
PYMODBUS = {
    "u16": "UINT16", "s16": "INT16", "u32": "UINT32", "s32": "INT32", "u64": "UINT64",
    "s64": "INT64", "f32": "FLOAT32", "f64": "FLOAT64",
}  # fmt: skip


def on_the_wire(big: bytes, order: str) -> bytes:
    """The bytes of a value, highest first, as they go over the wire in an order."""
    registers = [big[i : i + 2] for i in range(0, len(big), 2)]
    if order in ("CDAB", "DCBA"):
        registers.reverse()
    return b"".join(one[::-1] if order in ("BADC", "DCBA") else one for one in registers)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind", NUMPY)
@given(data=st.data())
def test_numbers_as_numpy_has_them(kind: str, order: str, data: st.DataObject) -> None:
    """Any bits, edge cases included, are converted to the same numbers as by numpy."""
    width = REGISTERS_OF_TYPE[kind]
    edge = st.sampled_from([b"\0" * width, b"\xff" * width, b"\x80" + b"\0" * (width - 1),
                            b"\x7f" + b"\xff" * (width - 1)])  # fmt: skip
    big = data.draw(st.binary(min_size=width, max_size=width) | edge)
    expected = np.frombuffer(big, NUMPY[kind])[0]
    number, text = _modlens.convert(kind, order, on_the_wire(big, order))
    if kind.startswith("f"):
        if not np.isfinite(expected):
            assert number is None
            assert text in ("NaN", "inf", "-inf")
        else:
            assert number == float(expected)
            # The text reads back as the same number of the same precision.
            assert expected.dtype.type(text) == expected
            assert math.copysign(1, float(str(text))) == math.copysign(1, expected)
    else:
        assert text == str(expected)
        exact = int(float(expected)) == int(expected)
        assert number == (float(expected) if exact else None)


@pytest.mark.parametrize("kind", PYMODBUS)
@pytest.mark.parametrize(("order", "words"), [("ABCD", "big"), ("CDAB", "little")])
@given(data=st.data())
def test_registers_as_pymodbus_has_them(
    kind: str, order: str, words: Literal["big", "little"], data: st.DataObject
) -> None:
    """Registers in both orders of words are converted to the same numbers as by pymodbus."""
    width = REGISTERS_OF_TYPE[kind]
    number = np.frombuffer(data.draw(st.binary(min_size=width, max_size=width)), NUMPY[kind])[0]
    if kind.startswith("f") and not np.isfinite(number):
        number = np.float32(1.5)
    sort = getattr(ModbusClientMixin.DATATYPE, PYMODBUS[kind])
    registers = ModbusClientMixin.convert_to_registers(number.item(), sort, word_order=words)
    _, text = _modlens.convert(kind, order, struct.pack(f">{len(registers)}H", *registers))
    assert number.dtype.type(text) == number


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("kind", "width"), [("bcd16", 2), ("bcd32", 4)])
@given(number=st.integers(0, 99_999_999))
def test_decimal_digits(kind: str, width: int, order: str, number: int) -> None:
    """BCD: the hexadecimal digits are the decimal ones."""
    number %= 10 ** (2 * width)
    big = bytes.fromhex(f"{number:0{2 * width}d}")
    assert _modlens.convert(kind, order, on_the_wire(big, order)) == (number, str(number))


def test_what_is_no_decimal_digit_is_no_value() -> None:
    """A BCD register such as 0x1A has no value."""
    assert _modlens.convert("bcd16", "ABCD", b"\x12\x3a") == (None, None)


@given(high=st.integers(0, 255), low=st.integers(0, 255))
def test_halves(high: int, low: int) -> None:
    """Of a register, with and without sign, as struct has them."""
    word = bytes([high, low])
    signed_high, signed_low = struct.unpack(">bb", word)
    for kind, expected in [("u8h", high), ("u8l", low), ("s8h", signed_high), ("s8l", signed_low)]:
        assert _modlens.convert(kind, "ABCD", word) == (expected, str(expected))
        other = {"h": "l", "l": "h"}[kind[-1]]
        assert _modlens.convert(kind[:-1] + other, "BADC", word) == (expected, str(expected))


@given(text=st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=16))
def test_text(text: str) -> None:
    """Two characters a register, either half first, or one in either half; zeros fill it up."""
    padded = text.encode() + b"\0" * (len(text) % 2)
    swapped = b"".join(padded[i : i + 2][::-1] for i in range(0, len(padded), 2))
    assert _modlens.convert("str", "ABCD", padded) == (None, text)
    assert _modlens.convert("str", "BADC", swapped) == (None, text)
    assert (
        _modlens.convert("strh", "ABCD", b"".join(bytes([c, 0]) for c in text.encode()))[1] == text
    )
    assert (
        _modlens.convert("strl", "ABCD", b"".join(bytes([0, c]) for c in text.encode()))[1] == text
    )


def test_text_ends_at_zero_and_blanks_at_its_end_go() -> None:
    """And what is no UTF-8 is Latin-1: no byte is lost."""
    assert _modlens.convert("str", "ABCD", b"ab  \0\0xy")[1] == "ab"
    assert _modlens.convert("str", "ABCD", b"\xb0C")[1] == "°C"
    assert _modlens.convert("raw", "ABCD", b"\x12\xab")[1] == "12ab"


def test_wrong_sizes_are_refused() -> None:
    """A wrong number of bytes is refused with the type's name."""
    with pytest.raises(ValueError, match="2 bytes are not a u32"):
        _modlens.convert("u32", "ABCD", b"ab")
    with pytest.raises(ValueError, match="no type"):
        _modlens.convert("u23", "ABCD", b"ab")


@given(
    raw=st.integers(0, 2**64 - 1),
    scale=st.decimals(-1000, 1000, places=4).filter(bool),
    offset=st.decimals(-1000, 1000, places=2),
)
def test_scaled_values_are_exact(raw: int, scale: Decimal, offset: Decimal) -> None:
    """Raw * scale + offset in the decimal arithmetic of Python, digit by digit."""
    point = f'type = "u64"\nscale = {scale:f}\noffset = {offset:f}'
    row = read_point(point, raw.to_bytes(8, "big"))
    exact = Decimal(raw) * scale + offset
    assert Decimal(row.value_text) == exact
    if abs(exact) < 2**53 and raw < 2**53:
        assert row.value == float(exact)


@pytest.mark.parametrize("nan", ["0x8000", "-32768", "[1, 0x8000]"])
def test_sentinels(nan: str) -> None:
    """A raw value, or a signed one, or one of several, means: no value."""
    point = f'type = "s16"\nscale = 0.1\nnan = {nan}'
    missing = read_point(point, b"\x80\x00")
    assert (missing.value, missing.value_text, missing.raw) == (None, None, [0x8000])
    assert read_point(point, b"\x80\x01").value_text == "-3276.7"


def test_labels_and_bits() -> None:
    """A label is in the text, the number stays the number."""
    point = 'enum = {3 = "auto"}'
    assert (read_point(point, b"\0\3").value, read_point(point, b"\0\3").value_text) == (3, "auto")
    assert read_point(point, b"\0\4").value_text == "4"
    flags = read_point('bits = {0 = "run", 9 = "fault"}', b"\x02\x03")
    assert (flags.value, flags.value_text) == (0x0203, "run fault bit1")
