"""What is in archives and mail: zip, tar (also compressed), and messages with attachments.

Nothing is written to disk, and nothing here knows where an archive lies: it reads an open file.
An archive or a member that cannot be read is a `CaptureError` with one sentence; the others can be
read all the same.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import IO, Any

from analyzer.sources.compression import damage_kinds, decompressor
from dissectors.errors import CaptureError

__all__ = ["MEMBER_SEPARATOR", "Member", "contents", "looks_like_archive"]

MEMBER_SEPARATOR = "!"
"""Stands between an archive and what is in it."""

MAX_MEMBERS = 20_000
"""An archive with more is refused: its list alone would fill the memory."""

_ZIP = b"PK\x03\x04"
_EMPTY_ZIP = b"PK\x05\x06"
_ZIP_NAME_OFFSET = 30
"""Where the name of the first file is in a zip."""
_SIGROK_MEMBERS = (b"version", b"metadata")
"""With these a session of sigrok begins, which is one recording, even a damaged one."""
_ENCRYPTED = 0x1
"""Bit 0 of a zip member's flags (APPNOTE 4.4.4)."""
_TAR_MAGIC = slice(257, 262)
"""Where `ustar` is in the first header of a tar (POSIX pax, "ustar Interchange Format")."""
_SAMPLE_BYTES = 4096
_MAIL_KEYS = {b"from", b"to", b"subject", b"date", b"mime-version", b"received"}
_ODD_NUMBERS: tuple[type[Exception], ...] = (ValueError, OverflowError)
"""What tarfile raises for numbers in headers that no file has."""


@dataclass(frozen=True, slots=True)
class Member:
    """A file in an archive; `open` gives its bytes, or raises `CaptureError`."""

    name: str
    open: Callable[[], IO[bytes]]


def looks_like_archive(head: bytes) -> bool:
    """Whether a file that begins so is a zip or a tar, and not a session of sigrok."""
    zipped = head.startswith((_ZIP, _EMPTY_ZIP)) and not head[_ZIP_NAME_OFFSET:].startswith(
        _SIGROK_MEMBERS
    )
    return zipped or head[_TAR_MAGIC] == b"ustar"


def contents(file: IO[bytes], name: str, opened: ExitStack) -> list[Member] | None:
    """What is in an archive or a mail, in its order; None for any other file.

    `opened` closes what has to stay open while members are read. `CaptureError` if the archive is
    damaged.
    """
    try:
        head = file.read(_SAMPLE_BYTES)
    except damage_kinds():
        return None  # the one who reads it says what is wrong
    file.seek(0)
    if looks_like_archive(head):
        return (_tar if head[_TAR_MAGIC] == b"ustar" else _zip)(file, name, opened)
    if (stream := decompressor(file, head)) is not None:
        opened.callback(stream.close)
        try:
            inner = stream.read(_SAMPLE_BYTES)
        except damage_kinds():
            inner = b""  # the one who reads it says what is wrong
        file.seek(0)
        if inner[_TAR_MAGIC] == b"ustar":
            plain = decompressor(file, head)
            assert plain is not None  # it was one a moment ago
            opened.callback(plain.close)
            return _tar(plain, name, opened)
        return None
    if name.lower().endswith(".eml") or _is_mail(head):
        from analyzer.sources.mail import contents as mail  # noqa: PLC0415 - most files are none

        # A name of an attachment may hold the mark that is between an archive and a member.
        return [Member(one.replace(MEMBER_SEPARATOR, "_"), open_it) for one, open_it in mail(file)]
    return None


def _is_mail(head: bytes) -> bool:
    """Whether a file that begins so has the headers of a message (RFC 5322, 3.6)."""
    lines = head.split(b"\n", 20)[:20]
    keys = {line.partition(b":")[0].strip().lower() for line in lines}
    return len(keys & _MAIL_KEYS) >= 3  # noqa: PLR2004


def _zip(file: IO[bytes], name: str, opened: ExitStack) -> list[Member] | None:
    import zipfile  # noqa: PLC0415 - most files are none

    try:
        archive = opened.enter_context(zipfile.ZipFile(file))
    except (zipfile.BadZipFile, NotImplementedError, ValueError, OSError) as error:
        raise CaptureError(f"a damaged zip archive ({error})", path=name) from error
    # A capture of sigrok is a zip as well, and one recording.
    if {"metadata", "version"} <= set(archive.namelist()):
        return None
    # A damaged directory may have empty names, which is_dir() of Python 3.11 does not expect.
    entries = [entry for entry in archive.infolist() if not entry.filename.endswith("/")]
    _check_number(len(entries), name)

    def opener(entry: zipfile.ZipInfo) -> Callable[[], IO[bytes]]:
        def open_entry() -> IO[bytes]:
            place = f"{name}{MEMBER_SEPARATOR}{entry.filename}"
            if entry.flag_bits & _ENCRYPTED:
                message = "encrypted; unpack the archive with its password first"
                raise CaptureError(message, path=place)
            try:
                return archive.open(entry)
            except Exception as error:
                # zipfile raises a dozen kinds for members that are odd: all mean the same here.
                raise CaptureError(f"cannot be unpacked ({error})", path=place) from error

        return open_entry

    return [Member(entry.filename, opener(entry)) for entry in entries]


def _tar(file: IO[bytes], name: str, opened: ExitStack) -> list[Member]:
    tarfile = importlib.import_module("tarfile")
    members: list[Member] = []
    try:
        archive = opened.enter_context(tarfile.open(fileobj=file, mode="r:"))
        for entry in archive:
            if not entry.isfile():
                continue  # directories, links and devices hold no bytes of their own
            members.append(Member(entry.name, partial(_extracted, archive, entry, name)))
            _check_number(len(members), name)
    except damage_kinds() + _ODD_NUMBERS as error:
        if not members:
            raise CaptureError(f"a damaged tar archive ({error})", path=name) from error
        # What is before the damage can be read.
        members.append(_damaged(name, f"{name}: damaged after {members[-1].name} ({error})"))
    return members


def _extracted(archive: Any, entry: Any, name: str) -> IO[bytes]:
    if entry.issparse():
        # Its size is a number in a header: a few bytes may stand for any amount of zeros.
        place = f"{name}{MEMBER_SEPARATOR}{entry.name}"
        raise CaptureError("a sparse file in a tar archive; unpack it first", path=place)
    try:
        found: IO[bytes] = archive.extractfile(entry)
    except Exception as error:
        # Headers of tar hold numbers and lists of holes that tarfile takes at their word.
        place = f"{name}{MEMBER_SEPARATOR}{entry.name}"
        raise CaptureError(f"cannot be unpacked ({error})", path=place) from error
    return found


def _damaged(name: str, message: str) -> Member:
    """A place in the list for what can't be read, so that it is reported in its turn."""

    def fail() -> IO[bytes]:
        raise CaptureError(message.removeprefix(f"{name}: "), path=name)

    return Member("(damaged)", fail)


def _check_number(members: int, name: str) -> None:
    if members > MAX_MEMBERS:
        message = f"more than {MAX_MEMBERS} files in one archive; unpack it and name the folder"
        raise CaptureError(message, path=name)
