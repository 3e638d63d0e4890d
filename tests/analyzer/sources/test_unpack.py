"""Recordings in other files: compressed, in archives, mail and directories, found as they are."""

from __future__ import annotations

import base64
import bz2
import gzip
import lzma
import os
import signal
import subprocess
import sys
import tarfile
import time
import zipfile
from collections.abc import Callable
from email.message import EmailMessage
from io import BytesIO
from pathlib import Path
from typing import IO

import pytest
import zstandard

import _modlens
from analyzer import decode
from analyzer.sources.unpack import expand
from dissectors.errors import CaptureError, SourceError
from tests.conftest import ROOT, Modlens, environment

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
    """Compression is detected by the first bytes, whatever the file's name is."""
    path = tmp_path / "bus.log"
    path.write_bytes(pack(TEXT))
    assert frames(path) == WIRE


def test_an_archive_stands_for_its_members(tmp_path: Path) -> None:
    """An archive stands for its members, those of nested archives included."""
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
    """Mail stands for its text and attachments, decoded."""
    mail = EmailMessage()
    mail["From"], mail["To"], mail["Subject"] = "a@example.org", "b@example.org", "the bus"
    mail.set_content(TEXT.decode(), cte="quoted-printable")
    mail.add_attachment(TEXT, maintype="application", subtype="octet-stream", filename="bus.hex")
    path = tmp_path / "question.eml"
    path.write_bytes(bytes(mail))
    assert frames(path) == WIRE * 2


def test_bad_base64_in_a_mail_is_decoded_as_far_as_it_goes(tmp_path: Path) -> None:
    """A character after the padding, which decoders refuse."""
    path = tmp_path / "question.eml"
    path.write_bytes(
        b"From: a@b\nTo: c@d\nSubject: x\nMIME-Version: 1.0\n"
        b"Content-Type: text/plain; name=a.log\nContent-Disposition: attachment; filename=a.log\n"
        b"Content-Transfer-Encoding: base64\n\n" + base64.b64encode(TEXT) + b"A\n"
    )
    assert frames(path) == WIRE


def test_a_mail_of_any_size_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The parser holds a message several times over."""
    monkeypatch.setattr("analyzer.sources.mail.MAX_MAIL_BYTES", 100)
    path = tmp_path / "question.eml"
    path.write_bytes(b"From: a@b\nTo: c@d\nSubject: x\n\n" + TEXT * 20)
    with pytest.raises(SourceError, match="save its attachments"):
        frames(path)


def test_a_sparse_file_in_a_tar_is_refused(tmp_path: Path) -> None:
    """A header of GNU tar lets a few bytes stand for terabytes of zeros."""
    header = bytearray(tarfile.TarInfo("bus.hex").tobuf(tarfile.GNU_FORMAT))
    header[156:157] = b"S"
    header[483:495] = b"77777777777\0"
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\0 " % sum(header)
    path = tmp_path / "bus.tar"
    path.write_bytes(bytes(header) + bytes(1024))
    with pytest.raises(CaptureError, match="sparse"):
        frames(path)


def test_a_directory_stands_for_the_files_in_it(tmp_path: Path) -> None:
    """In the order of their names; hidden ones are left alone."""
    for name in ("b.hex", "a.hex", ".hidden"):
        (tmp_path / name).write_bytes(TEXT)
    assert [Path(name.text).name for name in expand([str(tmp_path)])] == ["a.hex", "b.hex"]


def test_what_comes_before_the_damage_is_decoded(tmp_path: Path) -> None:
    """Of a truncated compressed file, the bytes before the damage are decoded."""
    path = tmp_path / "bus.hex.gz"
    path.write_bytes(gzip.compress(TEXT * 1000)[:-6])
    assert frames(path) == WIRE * 1000


@pytest.mark.parametrize("suffix", ["tar", "tar.gz", "tar.bz2", "tar.xz"])
def test_a_tar_stands_for_the_regular_files_in_it(suffix: str, tmp_path: Path) -> None:
    """Links and folders in a tar are skipped."""
    path = tmp_path / f"bus.{suffix}"
    pack: dict[str, Callable[[bytes], bytes]] = {
        "tar": bytes, "tar.gz": gzip.compress, "tar.bz2": bz2.compress, "tar.xz": lzma.compress
    }  # fmt: skip
    plain = BytesIO()
    with tarfile.open(fileobj=plain, mode="w") as archive:
        for name in ("a.hex", "folder/b.hex"):
            entry = tarfile.TarInfo(name)
            entry.size = len(TEXT)
            archive.addfile(entry, BytesIO(TEXT))
        link = tarfile.TarInfo("link")
        link.type, link.linkname = tarfile.SYMTYPE, "a.hex"
        archive.addfile(link)
    path.write_bytes(pack[suffix](plain.getvalue()))
    assert [name.text for name in expand([str(path)])] == [f"{path}!a.hex", f"{path}!folder/b.hex"]
    assert frames(path) == WIRE * 2


def test_a_bzip2_file_is_read_as_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes(bz2.compress(TEXT))
    assert frames(path) == WIRE


def encrypted(data: bytes) -> bytes:
    """The archive with bit 0 of its first member's flags set (APPNOTE 4.4.4): a password."""
    local, central = data.index(b"PK\x03\x04"), data.index(b"PK\x01\x02")
    changed = bytearray(data)
    changed[local + 6] |= 1
    changed[central + 8] |= 1
    return bytes(changed)


def damaged(data: bytes) -> bytes:
    """The archive with the bytes of its first member changed: its checksum is wrong."""
    at = data.index(TEXT[:20])
    return data[:at] + b"ZZ" + data[at + 2 :]


@pytest.mark.parametrize("change", [encrypted, damaged])
def test_a_member_that_cannot_be_read_is_reported_and_the_others_are_decoded(
    change: Callable[[bytes], bytes], modlens: Modlens, tmp_path: Path
) -> None:
    """One sentence for it, exit status 3 at the end, and no noise in its place."""
    path = tmp_path / "bus.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.hex", TEXT)
        archive.writestr("b.hex", TEXT)
    path.write_bytes(change(path.read_bytes()))
    out = tmp_path / "out.csv"
    done = modlens("export", path, "-o", f"frames:{out}", "--columns", "hex,verdict")
    assert done.status == 3
    rows = out.read_text().splitlines()[1:]
    assert rows[-2:] == [f"{one},ok" for one in WIRE]
    assert all(row.endswith(",ok") for row in rows)
    assert "a.hex" in done.err
    assert ("encrypted" if change is encrypted else "damaged") in done.err
    assert "Traceback" not in done.err


def test_an_archive_that_cannot_be_read_is_one_sentence(modlens: Modlens, tmp_path: Path) -> None:
    """By itself it ends the command; in a folder the others are decoded."""
    path = tmp_path / "bus.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.hex", TEXT)
    path.write_bytes(path.read_bytes()[:-10])
    done = modlens("decode", path)
    assert (done.status, done.out, done.err.count("\n")) == (3, "", 1)
    assert "damaged zip archive" in done.err
    (tmp_path / "good.hex").write_bytes(TEXT)
    done = modlens("export", tmp_path, "--to", "csv", "--columns", "request_hex")
    assert (done.status, WIRE[0] in done.out) == (3, True)


def test_an_archive_too_deep_in_others_is_not_taken_for_bytes_of_a_line(
    modlens: Modlens, tmp_path: Path
) -> None:
    data, name = TEXT, "bus.hex"
    for depth in range(6):
        packed = BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr(name, data)
        data, name = packed.getvalue(), f"{depth}.zip"
    path = tmp_path / name
    path.write_bytes(data)
    done = modlens("decode", path)
    assert (done.status, done.out) == (3, "")
    assert "unpack it first" in done.err


def test_a_fifo_in_a_folder_is_left_alone(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "bus.hex").write_bytes(TEXT)
    assert [Path(name.text).name for name in expand([str(tmp_path)])] == ["bus.hex"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_fifo_that_nobody_writes_to_obeys_the_first_signal(number: int, tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    words = [sys.executable, "-m", "analyzer", "decode", str(path)]
    with subprocess.Popen(
        words, env=environment(), cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        time.sleep(1.5)
        assert child.poll() is None
        child.send_signal(number)
        assert child.wait(timeout=5) != 0


def test_what_is_written_to_a_fifo_is_decoded(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    words = [sys.executable, "-m", "analyzer", "export", str(path), "--to", "csv"]
    with subprocess.Popen(words, env=environment(), cwd=ROOT, stdout=subprocess.PIPE) as child:
        with path.open("wb") as writer:
            writer.write(TEXT)
        out, _ = child.communicate(timeout=20)
    assert child.returncode == 0
    assert WIRE[0].encode() in out


def test_thousands_of_members_take_linear_time(tmp_path: Path) -> None:
    """Each opening of the archive again would list all of them: counted, not timed."""
    path = tmp_path / "many.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for number in range(300):
            archive.writestr(f"{number:03}.hex", TEXT)
    opened = []

    class Counting(zipfile.ZipFile):
        def __init__(self, file: IO[bytes]) -> None:
            opened.append(file)
            super().__init__(file)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zipfile, "ZipFile", Counting)
        assert frames(path) == WIRE * 300
    assert len(opened) <= 3


@pytest.mark.parametrize("order", [None, "raw"])
@pytest.mark.parametrize("head", ["fffe", "feff", "1f8b", "1f8b08", "425a68", "504b0304"])
def test_the_bytes_of_a_line_are_never_transformed(
    head: str, order: str | None, tmp_path: Path
) -> None:
    """FF FE is a glitch, 1F 8B unit 31 that refuses function 11: magic alone proves nothing."""
    data = bytes.fromhex(head) + bytes.fromhex("".join(WIRE) * 20)
    path = tmp_path / "bus.bin"
    path.write_bytes(data)
    if head == "504b0304" and order is None:
        with pytest.raises(CaptureError, match="zip"):
            list(decode(path).frames)  # the whole signature of a zip, and nobody denies it
        return
    rows = decode(path, read_as=order).frames
    assert b"".join(bytes(row.hex) for row in rows) == data


def test_a_member_of_a_zip_without_a_name(tmp_path: Path) -> None:
    """As a damaged directory has it: one sentence, and what is beside it is read."""
    packed = tmp_path / "bus.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("#", "no recording")
        archive.writestr("bus.log", TEXT)
    # A name ends at the first zero.
    packed.write_bytes(packed.read_bytes().replace(b"#", b"\0"))
    assert frames(packed) == WIRE


def test_bytes_between_the_magic_of_gzip_and_its_end(tmp_path: Path) -> None:
    """A refusal with exception 8: the three bytes are those of a gzip header."""
    body = bytes.fromhex("1f8b08")
    data = (body + _modlens.crc16(body).to_bytes(2, "little")) * 30
    path = tmp_path / "bus.bin"
    path.write_bytes(data)
    rows = decode(path).frames
    assert b"".join(bytes(row.hex) for row in rows) == data
    assert all(row.exception == 8 for row in rows)
