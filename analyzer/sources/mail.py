r"""What is in an e-mail: its text and its attachments, decoded while they are read.

The standard library's parser holds a message several times over. Here only the headers of the parts
are kept, and where in the file each part lies (RFC 2046, 5.1): a mail of any size takes little.

>>> import io
>>> file = io.BytesIO(b"From: a\nTo: b\nContent-Type: text/plain\n\n01 03\n")
>>> [(name, open_it().read()) for name, open_it in contents(file)]
[('part1.txt', b'01 03\n')]
"""

from __future__ import annotations

import binascii
import codecs
import importlib
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import IO, TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from email.message import EmailMessage

__all__ = ["contents"]

_BLOCK_BYTES = 64 * 1024
_MAX_HEADER_BYTES = 256 * 1024
_MAX_PARTS = 10_000
_ZIP = b"PK\x03\x04"
_BASE64 = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/="
_NOT_BASE64 = bytes(set(range(256)) - set(_BASE64))


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of a message: its number among all parts, its headers, and where its bytes lie."""

    number: int
    headers: EmailMessage
    start: int
    end: int


def contents(file: IO[bytes]) -> list[tuple[str, Callable[[], IO[bytes]]]]:
    """The names of text and attachments in their order, each with a function that opens it."""
    parts = list(_Scanner(file).parts())
    has_plain = any(part.headers.get_content_type() == "text/plain" for part in parts)
    found: list[tuple[str, Callable[[], IO[bytes]]]] = []
    for part in parts:
        name = part.headers.get_filename()
        kind = part.headers.get_content_type()
        if name is None and ((has_plain and kind == "text/html") or not kind.startswith("text/")):
            continue  # the same text again with its formatting, or nothing to read
        label = name or f"part{part.number}.txt"
        found.append((label, partial(_open, file, part, is_text=name is None)))
    return found


class _Scanner:
    """Goes through a message line by line."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._at = 0
        self._number = 0
        self._boundaries: list[bytes] = []
        file.seek(0)

    def parts(self) -> Iterator[_Part]:
        """The parts that hold bytes of their own."""
        more = True
        while more and self._number < _MAX_PARTS:
            self._number += 1
            number, headers = self._number, self._headers()
            boundary = headers.get_boundary()
            if headers.get_content_maintype() == "multipart" and boundary:
                self._boundaries.append(boundary.encode("utf-8", "surrogateescape"))
                _, more = self._to_delimiter()
            elif headers.get_content_type() != "message/rfc822":
                start = self._at
                end, more = self._to_delimiter()
                yield _Part(number, headers, start, end)

    def _headers(self) -> EmailMessage:
        policy, parser = (importlib.import_module(f"email.{name}") for name in ("policy", "parser"))
        lines, size = [], 0
        while (line := self._line()).strip() and size < _MAX_HEADER_BYTES:
            lines.append(line)
            size += len(line)
        found = parser.BytesHeaderParser(policy=policy.default).parsebytes(b"".join(lines))
        return cast("EmailMessage", found)

    def _to_delimiter(self) -> tuple[int, bool]:
        """Go behind the next line that separates parts.

        Gives where the bytes before it end, and whether another part follows.
        """
        line_end = 0
        starts_line = True
        while line := self._line():
            start = self._at - len(line)
            if starts_line and line.startswith(b"--") and (found := self._delimiter(line)):
                if found == "next":
                    return start - line_end, True
                end = start - line_end
                # Behind the end of a multipart only that around it goes on.
                return end, bool(self._boundaries) and self._to_delimiter()[1]
            starts_line = line.endswith(b"\n")
            line_end = 2 if line.endswith(b"\r\n") else int(starts_line)
        return self._at, False

    def _delimiter(self, line: bytes) -> str | None:
        """`next` or `end` for a line that separates parts of one of the multiparts around it."""
        text = line[2:].rstrip()
        for depth in range(len(self._boundaries), 0, -1):
            boundary = self._boundaries[depth - 1]
            if text == boundary:
                del self._boundaries[depth:]
                return "next"
            if text == boundary + b"--":
                del self._boundaries[depth - 1 :]
                return "end"
        return None

    def _line(self) -> bytes:
        line = self._file.readline(_BLOCK_BYTES)
        self._at += len(line)
        return line


def _open(file: IO[bytes], part: _Part, *, is_text: bool) -> IO[bytes]:
    def blocks() -> Iterator[bytes]:
        found = _decoded(_blocks(file, part), part.headers)
        return _as_utf8(found, part.headers) if is_text else found

    stream = cast("IO[bytes]", io.BufferedReader(_Stream(blocks), _BLOCK_BYTES))
    if stream.read(len(_ZIP)) == _ZIP:
        # A zip is read here and there.
        return io.BytesIO(_ZIP + stream.read())
    stream.seek(0)
    return stream


def _blocks(file: IO[bytes], part: _Part) -> Iterator[bytes]:
    at = part.start
    while at < part.end:
        if file.tell() != at:
            file.seek(at)
        block = file.read(min(_BLOCK_BYTES, part.end - at))
        if not block:
            return
        at += len(block)
        yield block


def _decoded(blocks: Iterator[bytes], headers: EmailMessage) -> Iterator[bytes]:
    """The bytes that a part stands for, by its transfer encoding (RFC 2045, 6)."""
    encoding = str(headers.get("content-transfer-encoding", "")).strip().lower()
    if encoding == "base64":
        yield from _from_base64(blocks)
    elif encoding == "quoted-printable":
        yield from _from_quoted_printable(blocks)
    elif encoding in ("x-uuencode", "uuencode", "uue", "x-uue"):
        headers.set_payload(b"".join(blocks).decode("ascii", "surrogateescape"))
        yield bytes(cast("bytes", headers.get_payload(decode=True)) or b"")
    else:
        yield from blocks


def _from_base64(blocks: Iterator[bytes]) -> Iterator[bytes]:
    left = b""
    for block in blocks:
        left += block.translate(None, _NOT_BASE64)
        whole = len(left) // 4 * 4
        yield binascii.a2b_base64(left[:whole])
        left = left[whole:]
    if len(left.rstrip(b"=")) > 1:
        yield binascii.a2b_base64(left.rstrip(b"=") + b"==")


def _from_quoted_printable(blocks: Iterator[bytes]) -> Iterator[bytes]:
    left = b""
    for block in blocks:
        whole, newline, left = (left + block).rpartition(b"\n")
        yield binascii.a2b_qp(whole + newline)
    yield binascii.a2b_qp(left)


def _as_utf8(blocks: Iterator[bytes], headers: EmailMessage) -> Iterator[bytes]:
    """A text in UTF-8, without the tags of HTML."""
    try:
        lookup = codecs.getincrementaldecoder(headers.get_content_charset() or "utf-8")
        decoder: Any = lookup("replace")
        decoder.decode(b"")
    except (LookupError, AttributeError, TypeError):
        decoder = codecs.getincrementaldecoder("utf-8")("replace")
    texts: Iterator[str] = (decoder.decode(block) for block in blocks)
    if headers.get_content_type() == "text/html":
        texts = _without_tags(texts)
    yield from (text.encode("utf-8", "replace") for text in texts)


def _without_tags(texts: Iterator[str]) -> Iterator[str]:
    parser = importlib.import_module("html.parser")
    pieces: list[str] = []

    class Plain(parser.HTMLParser):  # type: ignore[misc,name-defined] # loaded late
        def handle_data(self, data: str) -> None:
            pieces.append(data)

        def handle_starttag(self, tag: str, attrs: Any) -> None:
            if tag in ("br", "p", "div", "tr", "li", "pre"):
                pieces.append("\n")

    plain = Plain(convert_charrefs=True)
    for text in texts:
        plain.feed(text)
        yield "".join(pieces)
        pieces.clear()
    plain.close()
    yield "".join(pieces)


class _Stream(io.RawIOBase):
    """A file over blocks that are made anew for each pass; it goes back by beginning again."""

    def __init__(self, blocks: Callable[[], Iterator[bytes]]) -> None:
        self._make = blocks
        self._blocks = blocks()
        self._block = b""
        self._at = 0

    def readable(self) -> bool:
        """True."""
        return True

    def seekable(self) -> bool:
        """True; going back reads from the beginning."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer as far as the current block goes; 0 at the end."""
        while not self._block:
            found = next(self._blocks, None)
            if found is None:
                return 0
            self._block = found
        view = memoryview(buffer)
        taken = min(len(view), len(self._block))
        view[:taken] = self._block[:taken]
        self._block = self._block[taken:]
        self._at += taken
        return taken

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go to a place; the end is found by reading up to it."""
        target = offset if whence == io.SEEK_SET else self._at + offset
        if whence == io.SEEK_END:
            while self.read(_BLOCK_BYTES):
                pass
            target = self._at + offset
        if target < self._at:
            self._blocks, self._block, self._at = self._make(), b"", 0
        while self._at < target and self.read(min(_BLOCK_BYTES, target - self._at)):
            pass
        return self._at

    def tell(self) -> int:
        """The number of bytes before the current place."""
        return self._at
