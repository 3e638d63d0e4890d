"""Hex text of frames, as people paste it."""

from __future__ import annotations

import re

import _modlens
from dissectors.errors import UsageError

__all__ = ["frame_bytes", "parse_hex"]

_MBAP_BYTES = 7

_PREFIX = re.compile(r"0x|\\x", re.IGNORECASE)
_TOKENS = re.compile(r"[\s,;:\-\[\](){}<>\"']+")
_DIGITS = re.compile(r"[0-9A-Fa-f]+")


def frame_bytes(text: str, mode: str = "auto") -> tuple[bytes, str]:
    """The bytes of frames on the wire, and the mode to decode them in.

    Text that begins with a colon is of ASCII mode. `UsageError` for text that is not hex.

    >>> frame_bytes(":010300000001FB")[1], frame_bytes("0001 0000 0006 01 03 00 00 00 01")[1]
    ('ascii', 'tcp')
    """
    if text.lstrip().startswith(":"):
        return text.strip().encode("ascii", "replace") + b"\r\n", "ascii"
    data = parse_hex(text)
    return data, "tcp" if mode == "auto" and _looks_like_tcp(data) else mode


def _looks_like_tcp(data: bytes) -> bool:
    """Whether the bytes have a valid MBAP header and no valid CRC."""
    fits = (
        len(data) > _MBAP_BYTES
        and data[2:4] == b"\0\0"
        and int.from_bytes(data[4:6], "big") == len(data) - 6
    )
    return fits and _modlens.crc16(data[:-2]) != int.from_bytes(data[-2:], "little")


def parse_hex(text: str) -> bytes:
    """The bytes of hex digits in any spacing and notation; `UsageError` for other text.

    >>> parse_hex("0x01, 0x03").hex(), parse_hex("01-03:00 6b").hex(), parse_hex("1 3 0 6B").hex()
    ('0103', '0103006b', '0103006b')
    """
    tokens = [token for token in _TOKENS.split(_PREFIX.sub(" ", text)) if token]
    for token in tokens:
        if not _DIGITS.fullmatch(token):
            raise UsageError(f"show: {token!r} is not hex text, and there is no such file")
    if not tokens:
        raise UsageError("show: no hex digits")
    if all(len(token) <= len("FF") for token in tokens):
        tokens = [token.zfill(2) for token in tokens]
    digits = "".join(tokens)
    if len(digits) % 2:
        raise UsageError(f"show: {len(digits)} hex digits, but each byte takes two")
    return bytes.fromhex(digits)
