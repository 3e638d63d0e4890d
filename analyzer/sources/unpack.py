"""Recordings inside other files: compressed files, archives, mail, directories, patterns.

A file inside an archive is called `archive!member`. Nothing is written to disk.
"""

from __future__ import annotations

import glob
import importlib
import os
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from io import BytesIO
from typing import IO, TYPE_CHECKING, Any, cast

from dissectors.errors import SourceError

if TYPE_CHECKING:
    from email.message import EmailMessage

__all__ = ["MEMBER_SEPARATOR", "RecordingName", "decompressed", "expand", "open_member"]

MEMBER_SEPARATOR = "!"
"""Separates the name of an archive from that of a file in it."""

MAX_NESTING = 3
"""How deep archives may be nested; deeper ones are not opened."""

_MAGIC = {b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"\x28\xb5\x2f\xfd": "zstd"}
_ZIP = b"PK\x03\x04"
_ZIP_NAME_OFFSET = 30
"""Offset of the first file's name in a zip."""
_SIGROK_MEMBERS = (b"version", b"metadata")
"""The first files of a sigrok session, which is a zip, too, but one recording."""


@dataclass(frozen=True, slots=True)
class RecordingName:
    """The name of a recording.

    `found` is True where the user has not named it: it was found in a directory, archive or mail,
    and may be no recording at all.
    """

    text: str
    found: bool = False


def expand(names: list[str]) -> list[RecordingName]:
    """The recordings that names on the command line stand for.

    A directory stands for the files in it, a pattern for the matching files, an archive or mail for
    its contents. `SourceError` where that is nothing.
    """
    found: list[RecordingName] = []
    for name in names:
        paths = [name]
        if os.path.isdir(name):
            paths = sorted(_walk(name))
        elif any(mark in name for mark in "*?[") and not os.path.lexists(name):
            paths = sorted(glob.glob(name, recursive=True))
        if not paths:
            raise SourceError(f"{name}: no files; check the path")
        for path in paths:
            inside = _members_of(path)
            if inside is None:
                found.append(RecordingName(path, found=path != name))
            else:
                found += [
                    RecordingName(f"{path}{MEMBER_SEPARATOR}{member}", found=True)
                    for member in inside
                ]
    return found


def _walk(folder: str) -> Iterator[str]:
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(one for one in folders if not one.startswith("."))
        yield from (os.path.join(place, one) for one in files if not one.startswith("."))


def _members_of(path: str) -> list[str] | None:
    """The members of an archive or mail; None for any other file."""
    if not os.path.isfile(path):
        return None
    try:
        with ExitStack() as opened:
            return _members(opened.enter_context(open(path, "rb")), path, MAX_NESTING, opened)
    except OSError:
        # The caller will open the file and report why it cannot be read.
        return None


def _members(file: IO[bytes], name: str, depth: int, opened: ExitStack) -> list[str] | None:
    found = _contents(file, name, opened) if depth else None
    if found is None:
        return None
    members = []
    for member, content in found:
        with ExitStack() as inside:
            inner = _members(inside.enter_context(content()), member, depth - 1, inside)
        members += (
            [member] if inner is None else [f"{member}{MEMBER_SEPARATOR}{one}" for one in inner]
        )
    return members


def open_member(name: str, opened: ExitStack) -> IO[bytes] | None:
    """Open `archive!member`; None if the name is not of that form.

    The files it is read from are put into `opened`, and must stay open while it is read.
    """
    path, *members = name.split(MEMBER_SEPARATOR)
    while members and not os.path.isfile(path):
        path = f"{path}{MEMBER_SEPARATOR}{members.pop(0)}"
    if not members or os.path.lexists(name):
        return None
    file: IO[bytes] = opened.enter_context(open(path, "rb"))
    rest = MEMBER_SEPARATOR.join(members)
    place = path
    while rest:
        for member, content in _contents(file, place, opened) or ():
            if rest == member or rest.startswith(member + MEMBER_SEPARATOR):
                file, place = opened.enter_context(content()), member
                rest = rest[len(member) + 1 :]
                break
        else:
            raise SourceError(f"{name}: nothing of this name in {place}")
    return file


def _contents(file: IO[bytes], name: str, opened: ExitStack) -> list[tuple[str, Any]] | None:
    """Name and opener of each file in an archive or mail; None for any other file."""
    head = file.read(4096)
    file.seek(0)
    if head.startswith(_ZIP) and not head[_ZIP_NAME_OFFSET:].startswith(_SIGROK_MEMBERS):
        return _zip(file, name, opened)
    if name.lower().endswith(".eml") or _is_mail(head):
        return _mail(file)
    return None


def _zip(file: IO[bytes], name: str, opened: ExitStack) -> list[tuple[str, Any]] | None:
    import zipfile  # noqa: PLC0415 - most files are none

    try:
        archive = opened.enter_context(zipfile.ZipFile(file))
        # A session of sigrok is a zip, too, but it is one recording.
        if "metadata" in archive.namelist() and "version" in archive.namelist():
            return None
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
    except (zipfile.BadZipFile, NotImplementedError) as error:
        raise SourceError(f"{name}: a damaged archive: {error}") from error

    def opener(entry: zipfile.ZipInfo) -> Any:
        def content() -> IO[bytes]:
            try:
                return archive.open(entry)
            except (RuntimeError, NotImplementedError, zipfile.BadZipFile) as error:
                raise SourceError(f"{name}{MEMBER_SEPARATOR}{entry.filename}: {error}") from error

        return content

    return [(entry.filename, opener(entry)) for entry in entries]


def _is_mail(head: bytes) -> bool:
    lines = head.split(b"\n", 20)[:20]
    keys = {line.partition(b":")[0].strip().lower() for line in lines}
    return len(keys & {b"from", b"to", b"subject", b"date", b"mime-version", b"received"}) >= 3  # noqa: PLR2004


def _mail(file: IO[bytes]) -> list[tuple[str, Any]]:
    email, policy = importlib.import_module("email"), importlib.import_module("email.policy")
    message = cast("EmailMessage", email.message_from_binary_file(file, policy=policy.default))
    plain = [part for part in message.walk() if part.get_content_type() == "text/plain"]
    found: list[tuple[str, Any]] = []
    for number, part in enumerate(message.walk(), 1):
        if part.is_multipart():
            continue
        name = part.get_filename()
        if name is None and part.get_content_type() == "text/html" and plain:
            # The HTML part repeats the text part.
            continue
        if name is None and part.get_content_maintype() != "text":
            continue
        data = _text(part) if name is None else bytes(part.get_payload(decode=True) or b"")
        label = (name or f"part{number}.txt").replace(MEMBER_SEPARATOR, "_")
        found.append((label, lambda data=data: BytesIO(data)))
    return found


def _text(part: Any) -> bytes:
    data = bytes(part.get_payload(decode=True) or b"")
    charset = part.get_content_charset() or "utf-8"
    try:
        text = data.decode(charset, "replace")
    except LookupError:
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

    Plain(convert_charrefs=True).feed(text)
    return "".join(pieces)


def decompressed(file: Any, head: bytes, name: str) -> Any | None:
    """Open the contents of a compressed file that begins with `head`; None if not compressed.

    Closing it leaves `file` open. `SourceError` where it needs a package that is not installed.
    """
    kind = next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), None)
    if kind is None:
        return None
    if kind == "gzip":
        return importlib.import_module("gzip").GzipFile(fileobj=file)
    if kind == "xz":
        return importlib.import_module("lzma").LZMAFile(file)
    try:
        zstandard = importlib.import_module("zstandard")
    except ImportError as error:
        raise SourceError(
            f"{name}: compressed by zstd; pip install 'modlens[zstd]', or pipe it through zstdcat"
        ) from error
    return zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
