"""Recordings in other files: compressed, in archives, mail and directories, found as they are."""

from __future__ import annotations

import gzip
import lzma
import zipfile
from collections.abc import Callable
from email.message import EmailMessage
from pathlib import Path

import pytest
import zstandard

from analyzer import decode
from analyzer.sources.unpack import expand

# The example of section 6.3 of the specification, with the checksums that go with unit 1.
WIRE = ["0103006b00037417", "010306022b00000064057a"]
TEXT = "".join(f"{line}\n" for line in WIRE).encode()


def frames(path: Path) -> list[str]:
    """The frames of a recording, in hex."""
    return [row.hex.hex() for row in decode(path).frames]


@pytest.mark.parametrize(
    "pack", [gzip.compress, lzma.compress, zstandard.compress], ids=["gz", "xz", "zst"]
)
def test_a_compressed_file_is_read_as_what_it_holds(
    pack: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    """By its first bytes, whatever its name is."""
    path = tmp_path / "bus.log"
    path.write_bytes(pack(TEXT))
    assert frames(path) == WIRE


def test_an_archive_stands_for_its_members(tmp_path: Path) -> None:
    """Those in archives inside of it, too."""
    inner = tmp_path / "inner.zip"
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("b.hex", TEXT)
    outer = tmp_path / "outer.zip"
    with zipfile.ZipFile(outer, "w") as archive:
        archive.writestr("a.hex", TEXT)
        archive.write(inner, "inner.zip")
    assert [name.text for name in expand([str(outer)])] == [
        f"{outer}!a.hex",
        f"{outer}!inner.zip!b.hex",
    ]
    assert frames(outer) == WIRE * 2


def test_mail_stands_for_its_text_and_attachments(tmp_path: Path) -> None:
    """Quoted-printable and base64 are undone."""
    mail = EmailMessage()
    mail["From"], mail["To"], mail["Subject"] = "a@example.org", "b@example.org", "the bus"
    mail.set_content(TEXT.decode(), cte="quoted-printable")
    mail.add_attachment(TEXT, maintype="application", subtype="octet-stream", filename="bus.hex")
    path = tmp_path / "question.eml"
    path.write_bytes(bytes(mail))
    assert frames(path) == WIRE * 2


def test_a_directory_stands_for_the_files_in_it(tmp_path: Path) -> None:
    """In the order of their names; hidden ones are left alone."""
    for name in ("b.hex", "a.hex", ".hidden"):
        (tmp_path / name).write_bytes(TEXT)
    assert [Path(name.text).name for name in expand([str(tmp_path)])] == ["a.hex", "b.hex"]


def test_what_comes_before_the_damage_is_decoded(tmp_path: Path) -> None:
    """A file that was cut off in transfer."""
    path = tmp_path / "bus.hex.gz"
    path.write_bytes(gzip.compress(TEXT * 1000)[:-6])
    assert frames(path) == WIRE * 1000
