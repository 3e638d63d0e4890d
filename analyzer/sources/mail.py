r"""What is in an e-mail: its text and its attachments, as the standard library decodes them.

>>> import io
>>> file = io.BytesIO(b"From: a\nTo: b\nContent-Type: text/plain\n\n01 03\n")
>>> [(name, open_it().read()) for name, open_it in contents(file)]
[('part1.txt', b'01 03\n')]
"""

from __future__ import annotations

import binascii
import importlib
import io
import re
from collections.abc import Callable
from functools import partial
from typing import IO, TYPE_CHECKING, Any, cast

from dissectors.errors import SourceError

if TYPE_CHECKING:
    from email.message import EmailMessage

__all__ = ["MAX_MAIL_BYTES", "contents"]

MAX_MAIL_BYTES = 24 << 20
"""The parser holds a message several times over, so a larger one is refused."""


def contents(file: IO[bytes]) -> list[tuple[str, Callable[[], IO[bytes]]]]:
    """The names of text and attachments in their order, each with a function that opens it."""
    file.seek(0)
    data = file.read(MAX_MAIL_BYTES + 1)
    if len(data) > MAX_MAIL_BYTES:
        raise SourceError(
            f"a mail of more than {MAX_MAIL_BYTES >> 20} MB; save its attachments and open these"
        )
    policy, parser = (importlib.import_module(f"email.{name}") for name in ("policy", "parser"))
    message = parser.BytesParser(policy=policy.default).parsebytes(data)
    parts = [(at, part) for at, part in enumerate(message.walk(), 1) if not part.is_multipart()]
    has_plain = any(part.get_content_type() == "text/plain" for _, part in parts)
    found: list[tuple[str, Callable[[], IO[bytes]]]] = []
    for number, part in parts:
        name, kind = part.get_filename(), part.get_content_type()
        if name is None and ((has_plain and kind == "text/html") or not kind.startswith("text/")):
            continue  # the same text again with its formatting, or nothing to read
        found.append((name or f"part{number}.txt", partial(_open, part, is_text=name is None)))
    return found


def _open(part: EmailMessage, *, is_text: bool) -> IO[bytes]:
    """The decoded bytes of a part; of bad base64 what can be decoded."""
    if str(part.get("content-transfer-encoding", "")).strip().lower() == "base64":
        data = _from_base64(str(part.get_payload()))
    else:
        data = cast("bytes | None", part.get_payload(decode=True)) or b""
    return io.BytesIO(_as_utf8(data, part) if is_text else data)


def _from_base64(text: str) -> bytes:
    """The bytes of base64; a character that ends nothing is left out, and padding ends a block."""
    pieces = re.split("=+", re.sub(r"[^A-Za-z0-9+/=]", "", text))
    whole = (piece[: len(piece) - (len(piece) % 4 == 1)] for piece in pieces)
    return b"".join(binascii.a2b_base64(piece + "==") for piece in whole)


def _as_utf8(data: bytes, part: EmailMessage) -> bytes:
    """A text in UTF-8, without the tags of HTML."""
    try:
        text = data.decode(part.get_content_charset() or "utf-8", "replace")
    except (LookupError, ValueError):
        text = data.decode("utf-8", "replace")
    if part.get_content_type() == "text/html":
        text = _without_tags(text)
    return text.encode("utf-8", "replace")


def _without_tags(text: str) -> str:
    parser = importlib.import_module("html.parser")
    pieces: list[str] = []

    class Plain(parser.HTMLParser):  # type: ignore[misc,name-defined] # loaded late
        def handle_data(self, data: str) -> None:
            pieces.append(data)

        def handle_starttag(self, tag: str, attrs: Any) -> None:
            if tag in ("br", "p", "div", "tr", "li", "pre"):
                pieces.append("\n")

    plain = Plain(convert_charrefs=True)
    plain.feed(text)
    plain.close()
    return "".join(pieces)
