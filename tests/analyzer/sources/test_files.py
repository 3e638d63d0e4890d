"""Recordings: files, pipes and standard input, in blocks."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest

from analyzer import SourceError, UsageError, decode
from analyzer.sources import files
from analyzer.sources.files import Recording

HEX = b"01 03 00 6B 00 03 74 17\n"


def test_all_bytes_come_in_order(tmp_path: Path) -> None:
    """The sample that was looked at is delivered like all others."""
    data = HEX * 40_000
    path = tmp_path / "long.hex"
    path.write_bytes(data)
    with Recording(str(path)) as recording:
        blocks = list(recording.blocks())
    assert b"".join(blocks) == data
    assert max(map(len, blocks)) <= files.BLOCK_BYTES


@pytest.mark.skipif(sys.platform == "win32", reason="pipes by name")
def test_a_pipe_is_read_as_it_comes(tmp_path: Path) -> None:
    """An empty block says that nothing has come yet."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    go_on = threading.Event()

    def write() -> None:
        with path.open("wb", buffering=0) as pipe:
            pipe.write(HEX)
            go_on.wait(10)
            pipe.write(HEX)

    writer = threading.Thread(target=write)
    writer.start()
    received = []
    with Recording(str(path)) as recording:
        for block in recording.blocks():
            received.append(block)
            if not block:
                go_on.set()
    writer.join()
    assert b"".join(received) == HEX * 2
    assert b"" in received


def refused(path: Path | str, read_as: str | None = None) -> str:
    """What is said when this cannot be read."""
    with pytest.raises(SourceError) as caught:
        Recording(str(path), read_as=read_as)
    return str(caught.value)


def test_what_is_no_file(tmp_path: Path) -> None:
    """Missing, a directory, below a file, a name that cannot be."""
    (tmp_path / "file").write_bytes(HEX)
    assert "no such file" in refused(tmp_path / "no.hex")
    assert "no such file" in refused(tmp_path / "file" / "below.hex")
    assert "a directory; name the files in it" in refused(tmp_path)
    assert "null" in refused("a\0b")


def test_an_empty_file(tmp_path: Path) -> None:
    """An empty file is refused."""
    path = tmp_path / "empty.bin"
    path.touch()
    assert refused(path) == f"{path}: empty"


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="permissions of POSIX")
def test_a_file_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Told by name; root, who may read all, is asked to pretend."""
    path = tmp_path / "secret.hex"
    path.write_bytes(HEX)
    path.chmod(0)
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert refused(path) == f"{path}: no permission to read it"


def test_binary_is_not_text(tmp_path: Path) -> None:
    """An order that cannot be meant is refused, with what to do instead."""
    path = tmp_path / "bus.bin"
    path.write_bytes(bytes.fromhex("0103006b00037417") * 10)
    assert "binary data, not hex text; leave --from out, or use --from raw" in refused(path, "hex")


def test_text_is_not_binary(tmp_path: Path) -> None:
    """Binary data forced to be text is refused, and text forced to be binary."""
    path = tmp_path / "bus.hex"
    path.write_bytes(HEX * 10)
    said = refused(path, "raw")
    assert "text (hex: " in said
    assert "leave --from out, or use --from hex" in said


def test_text_of_no_known_form(tmp_path: Path) -> None:
    """A text without bytes of a line is refused."""
    path = tmp_path / "letter.txt"
    path.write_text("Dear customer,\nthe meter stopped on Monday.\n" * 20)
    assert "modlens formats" in refused(path)


def test_a_format_that_does_not_exist(tmp_path: Path) -> None:
    """An unknown format is reported with the known ones."""
    path = tmp_path / "bus.hex"
    path.write_bytes(HEX)
    with pytest.raises(UsageError, match=r"no such format; did you mean 'hex'\?"):
        Recording(str(path), read_as="hexx")


def test_start_times_of_frames_that_come_back_to_back_do_not_run_back(tmp_path: Path) -> None:
    """Two frames in a read that comes 0.1 ms after the one before: 17 characters take 1.5 ms."""
    request, response = "010300000002c40b", "01030400000000fa33"
    reads = [(0, request), (1, response + request), (2, response + request)]
    path = tmp_path / "reads.jsonl"
    path.write_text(
        "".join(f'{{"t": 1795375189.000{ticks}, "hex": "{data}"}}\n' for ticks, data in reads),
        "ascii",
    )
    rows = decode(path, line="115200-8N1").frames
    times = [row.time for row in rows]
    assert len(times) == 5
    assert times == sorted(times)
