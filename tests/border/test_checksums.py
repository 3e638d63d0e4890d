"""CRC and LRC against the specification's algorithms, done slowly, bit by bit."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

import _modlens

POLYNOMIAL = 0xA001


def slow_crc(data: bytes) -> int:
    """Return the CRC as the serial line specification describes it in 6.2.2."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            low = register & 1
            register >>= 1
            if low:
                register ^= POLYNOMIAL
    return register


def slow_lrc(data: bytes) -> int:
    """Return the LRC as 6.2.1 describes it: the negative of the sum, in one byte."""
    total = 0
    for byte in data:
        total = (total + byte) & 0xFF
    return (0x100 - total) & 0xFF


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=300))
def test_checksums_are_those_of_the_specification(data: bytes) -> None:
    """Checksums are those of the specification, for any bytes, length and alignment."""
    assert _modlens.crc16(data) == slow_crc(data)
    assert _modlens.lrc(data) == slow_lrc(data)


@settings(deadline=None)
@given(st.binary(min_size=1, max_size=260))
def test_a_frame_with_its_crc_has_the_crc_zero(data: bytes) -> None:
    """The property by which receivers check: the CRC over frame and CRC is 0."""
    assert _modlens.crc16(data + _modlens.crc16(data).to_bytes(2, "little")) == 0


def test_known_checksums() -> None:
    """02 07 gives 41 12 on the wire (6.2.2), the CRC's check value is 4B37."""
    assert _modlens.crc16(bytes([0x02, 0x07])) == 0x1241
    assert _modlens.crc16(b"123456789") == 0x4B37
    assert _modlens.crc16(b"") == 0xFFFF
    assert _modlens.lrc(bytes.fromhex("1103006B0003")) == 0x7E
    assert _modlens.lrc(b"") == 0
