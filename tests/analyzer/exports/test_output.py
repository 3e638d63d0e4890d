"""Where exported bytes go: whole or not at all, or growing and never over another file."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import pytest

import _modlens
from analyzer import SourceError, decode
from analyzer.exports.output import AtomicFile, GrowingFile, append_pieces

FULL = Path("/dev/full")


def test_a_whole_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    """Until `close` there is no file of the name."""
    path = tmp_path / "out.csv"
    output = AtomicFile(str(path))
    output.append(b"one\n")
    output.append(b"two\n")
    assert not path.exists()
    output.close()
    assert path.read_bytes() == b"one\ntwo\n"
    assert list(tmp_path.iterdir()) == [path]


def test_a_whole_file_takes_the_place_of_an_old_one(tmp_path: Path) -> None:
    """An existing file stays unchanged until `close`."""
    path = tmp_path / "out.csv"
    path.write_bytes(b"old")
    output = AtomicFile(str(path))
    output.append(b"new")
    assert path.read_bytes() == b"old"
    output.close()
    assert path.read_bytes() == b"new"


def test_an_abandoned_file_leaves_nothing(tmp_path: Path) -> None:
    """Neither under its name nor under another; closing it then is no harm."""
    output = AtomicFile(str(tmp_path / "out.csv"))
    output.append(b"half")
    output.rollback()
    output.close()
    output.append(b"more")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
def test_a_file_has_the_usual_permissions(tmp_path: Path) -> None:
    """Those that the user's mask leaves, not those of a temporary file."""
    path = tmp_path / "out.csv"
    mask = os.umask(0o022)
    try:
        AtomicFile(str(path)).close()
    finally:
        os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644


@pytest.mark.skipif(sys.platform == "win32", reason="links of POSIX")
def test_a_link_is_followed(tmp_path: Path) -> None:
    """The target of a link is replaced, not the link."""
    target, link = tmp_path / "target.csv", tmp_path / "link.csv"
    target.write_bytes(b"old")
    link.symlink_to(target)
    output = AtomicFile(str(link))
    output.append(b"new")
    output.close()
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


def test_a_growing_file_never_replaces_another(tmp_path: Path) -> None:
    """An existing file is refused, with advice."""
    path = tmp_path / "out.csv"
    path.write_bytes(b"precious")
    with pytest.raises(SourceError, match="never overwrites; choose another name"):
        GrowingFile(str(path))
    assert path.read_bytes() == b"precious"


def test_a_growing_file_can_be_read_while_it_grows(tmp_path: Path) -> None:
    """What was appended is there, also if nobody closes it."""
    path = tmp_path / "out.csv"
    output = GrowingFile(str(path))
    output.append(b"one\n")
    assert path.read_bytes() == b"one\n"
    output.rollback()
    assert path.read_bytes() == b"one\n"


@pytest.mark.parametrize("kind", [AtomicFile, GrowingFile])
def test_what_cannot_be_written(kind: type[AtomicFile | GrowingFile], tmp_path: Path) -> None:
    """A missing folder and a folder instead of a file are reported."""
    with pytest.raises(SourceError, match="its directory does not exist"):
        kind(str(tmp_path / "no" / "out.csv"))
    with pytest.raises(SourceError, match="is a directory"):
        kind(str(tmp_path)).close()


@pytest.mark.skipif(not FULL.exists(), reason="/dev/full")
@pytest.mark.parametrize("kind", [AtomicFile, GrowingFile])
def test_a_full_disk_is_reported_once(kind: type[AtomicFile | GrowingFile], tmp_path: Path) -> None:
    """After the error no more bytes are written."""
    link = tmp_path / "out.csv"
    link.symlink_to(FULL)
    output = kind(str(link))
    with pytest.raises(SourceError, match=r"out\.csv: cannot be written: no space left"):
        output.append(b"x" * 100)
    output.append(b"more")
    output.close()
    assert FULL.exists()


def batches(captures: Path) -> list[_modlens.Batch]:
    """Those of a recording, again and again."""
    return (
        list(
            decode(captures / "pymodbus_all_functions" / "recording.jsonl").batches("transactions")
        )
        * 400
    )


@pytest.mark.parametrize("kind", [AtomicFile, GrowingFile])
@pytest.mark.parametrize("name", ["csv", "jsonl"])
def test_lines_are_the_bytes_that_they_are_made_of(
    kind: type[AtomicFile | GrowingFile], name: str, tmp_path: Path, captures: Path
) -> None:
    """Lines that go straight to a file are those that come as bytes, also with others between."""
    path = tmp_path / "out"
    columns = [
        "txn",
        "time",
        "bus",
        "unit",
        "function",
        "data",
        "write_data",
        "request_hex",
        "source",
    ]
    lines = _modlens.LineEncoder(name, "transactions", columns)
    output, expected = kind(str(path)), b""
    for number, batch in enumerate(batches(captures)):
        header = number % 50 == 0
        append_pieces(output, lines.pieces(batch.transactions, header=header))
        expected += b"".join(batch.transactions.lines(name, columns, header=header))
        if number % 70 == 0:
            output.append(b"between\n")
            expected += b"between\n"
        if kind is GrowingFile and number % 40 == 0:
            assert path.read_bytes() == expected
    output.close()
    assert path.read_bytes() == expected
    assert len(expected) > 1 << 18
