r"""Detects the encoding of text files and converts it to UTF-8, which the core reads.

>>> detect_encoding("\u53d1\u2192 05 03".encode("gbk")), detect_encoding(b"05 03")
('gbk', None)
>>> detect_encoding("05 03".encode("utf-16-le"))
'utf-16-le'
"""

from __future__ import annotations

import codecs

__all__ = ["Transcoder", "detect_encoding", "is_utf8"]

_BOMS = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}

_MIN_ZERO_SHARE = 0.4
"""Share of zero bytes at every other place from which a text is taken for UTF-16."""

_MIN_ASCII_SHARE = 0.4
"""Share of ASCII characters in a log, whatever its language: hex digits, spaces, times."""

_MAX_CONTROL_SHARE = 0.02
"""More control characters than this are no text."""

_MIN_CHARACTERS = 4
"""A text of fewer characters is not judged: a short Modbus frame has zeros at such places, too."""

_NO_CONTROLS = bytes([*b"\t\n\v\f\r\x1b", *range(0x20, 0x100)])


def is_utf8(sample: bytes) -> bool:
    """Whether these bytes are UTF-8; the last character may be cut off."""
    try:
        codecs.getincrementaldecoder("utf-8")().decode(sample)
    except UnicodeDecodeError:
        return False
    return True


def detect_encoding(sample: bytes) -> str | None:
    """The encoding of a text that begins with `sample`; None for UTF-8, ASCII and binary data."""
    for bom, name in _BOMS.items():
        # FF FE can be a glitch in front of the first frame of a raw recording.
        if sample.startswith(bom) and _is_mostly_plain(sample[len(bom) :], name):
            return name
    for name, zeros in (("utf-16-le", sample[1::2]), ("utf-16-be", sample[::2])):
        if (
            len(zeros) >= _MIN_CHARACTERS
            and zeros.count(0) > _MIN_ZERO_SHARE * len(zeros)
            and _is_plain(sample, name)
        ):
            return name
    if is_utf8(sample) or sample.translate(None, _NO_CONTROLS):
        return None
    if sum(byte >= 0x80 for byte in sample) * 2 > len(sample):  # noqa: PLR2004 - beyond ASCII
        return None
    try:
        codecs.getincrementaldecoder("gbk")().decode(sample)
    except UnicodeDecodeError:
        return "cp1251"
    return "gbk"


def _is_mostly_plain(sample: bytes, encoding: str) -> bool:
    """Whether most characters are printable ASCII, as in a log, and hardly any are controls."""
    text = codecs.getincrementaldecoder(encoding)("replace").decode(sample)
    ascii_letters = sum(" " <= letter <= "~" or letter in "\t\r\n" for letter in text)
    controls = sum(letter < " " and letter not in "\t\r\n\x1b" for letter in text)
    return ascii_letters > _MIN_ASCII_SHARE * len(text) and controls <= _MAX_CONTROL_SHARE * len(
        text
    )


def _is_plain(sample: bytes, encoding: str) -> bool:
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(sample)
    except UnicodeDecodeError:
        return False
    return all(letter.isprintable() or letter in "\t\n\r\ufeff" for letter in text)


class Transcoder:
    """Converts blocks of an encoding to UTF-8; undecodable bytes become U+FFFD."""

    def __init__(self, encoding: str) -> None:
        self._decoder = codecs.getincrementaldecoder(encoding)("replace")

    def __call__(self, block: bytes, *, final: bool = False) -> bytes:
        """Convert one block; `final` is True for the last one."""
        return self._decoder.decode(block, final).encode("utf-8", "replace")
