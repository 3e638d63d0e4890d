"""Wrong use: one line that says what to do, the right exit status, no traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import CAPTURES, ROOT, Done, Modlens, command, environment

SEED = CAPTURES / "seed_rtu" / "recording.hex"
RAW = CAPTURES / "seed_ascii" / "recording.bin"

WRONG: list[tuple[int, str, list[str | Path]]] = [
    (2, "unknown command 'decod'; did you mean 'decode'?", ["decod"]),
    (2, "unknown command 'frobnicate'; choose from tap, decode,", ["frobnicate"]),
    (2, "decode: the following arguments are required: FILE", ["decode"]),
    (2, "unrecognized arguments: --wher", ["decode", SEED, "--wher", "x"]),
    (2, "modlens stats FILE --where 'unit == 3'", ["stats", SEED, "--unit", "3"]),
    (2, "modlens decode FILE --where 'unit == 3'", ["show", "0103", "--unit", "3"]),
    (2, "modlens report FILE -o report.html", ["report", SEED]),
    (2, "(column 1 of 'error')", ["decode", SEED, "--where", "error", "--between", "1", "2"]),
    (2, "invalid choice: 'frame'", ["decode", SEED, "--table", "frame"]),
    (2, "no column 'untis' (column 1 of", ["decode", SEED, "--where", "untis == 1"]),
    (2, "no column 'untis' in transactions", ["decode", SEED, "--to", "csv", "--columns", "untis"]),
    (2, "--columns needs --to csv or -o FILE", ["decode", SEED, "--columns", "unit"]),
    (2, "not an expression", ["decode", SEED, "--where", "unit =="]),
    (2, "no format 'cvs' to write; did you mean 'csv'?", ["decode", SEED, "--to", "cvs"]),
    (2, "out.xyz: unknown extension; use one of .csv,", ["decode", SEED, "-o", "out.xyz"]),
    (2, "two outputs in one file", ["decode", SEED, "-o", "x.csv", "-o", "frames:x.csv"]),
    (2, "no output given", ["export", SEED]),
    (2, "--from hexx: no such format", ["decode", SEED, "--from", "hexx"]),
    (2, "line settings \"fast\"; give", ["decode", SEED, "--line", "fast"]),
    (2, "--baud is missing", ["decode", SEED, "--parity", "E"]),
    (2, "--line gives all settings", ["decode", SEED, "--line", "9600-8N1", "--baud", "9600"]),
    (2, "9 data bits", ["decode", SEED, "--baud", "9600", "--bits", "9"]),
    (2, "--timeout soon: give a time in ms, s, min, h", ["decode", SEED, "--timeout", "soon"]),
    (2, "--timeout -1: give a time", ["decode", SEED, "--timeout=-1"]),
    (2, "--date 1.2.2026: write the date as 2026-", ["decode", SEED, "--date", "1.2.2026"]),
    (2, "--date 20261121: write the date", ["decode", SEED, "--date", "20261121"]),
    (2, "--functions nobody:", ["decode", SEED, "--functions", "nobody"]),
    (3, "--functions no.toml: cannot be read", ["decode", SEED, "--functions", "no.toml"]),
    (2, "tap: no port given; modlens ports lists them", ["tap", "--line", "9600-8N1"]),
    (4, "no such port; check the name", ["tap", "/dev/no-such-port", "--line", "9600-8N1"]),
    (4, "not a serial port", ["tap", SEED, "--line", "9600-8N1"]),
    (2, "unknown port type", ["tap", "tcp://x:1", "--line", "9600-8N1"]),
    (4, "connection was refused", ["tap", "socket://127.0.0.1:1", "--line", "9600-8N1"]),
    (2, "a bus has at most two lines", ["tap", "a+b+c", "--line", "9600-8N1"]),
    (3, "no.bin: no such file", ["decode", "no.bin"]),
    (3, "no.bin: no such file", ["decode", SEED, "no.bin", "-o", "never.csv"]),
    (3, "no.bin: no such file", ["stats", "no.bin"]),
    (3, "text (hex:", ["decode", SEED, "--from", "raw"]),
    (3, "its directory does not exist", ["decode", SEED, "-o", "no/such/folder/out.csv"]),
    (2, "show: add --frame N, --txn N or --packet N", ["show", SEED]),
    (2, "'zz' is not hex text, and there is no such file", ["show", "zz"]),
    (2, "3 hex digits, but each byte takes two", ["show", "123"]),
    (2, "there is no frame 999; ", ["show", SEED, "--frame", "999"]),
    (2, "--where '10 <= txn <= 20'", ["show", SEED, "--txn", "10-20"]),
    (2, "there is no transaction 0; ", ["show", SEED, "--txn", "0"]),
    (2, "either --frame or --txn", ["show", SEED, "--frame", "1", "--txn", "1"]),
    (3, "no.hex: no such file", ["show", "no.hex", "--frame", "1"]),
    (2, "no such code or name: 'florb'", ["explain", "florb"]),
    (2, "no function 'read holding'; did you mean", ["craft", "read holding"]),
    (2, "needs address, a number", ["craft", "3", "quantity=1"]),
    (2, "write a field as name=value", ["craft", "3", "address"]),
    (2, "unit=x: not a number", ["craft", "3", "unit=x"]),
    (2, "formats: unrecognized arguments", ["formats", "more"]),
]  # fmt: skip


def check(done: Done, status: int, message: str) -> None:
    """One line on standard error, nothing else."""
    assert done.status == status, done
    assert done.out == ""
    assert done.err.startswith("modlens: ")
    assert done.err.count("\n") == 1
    assert message in done.err


@pytest.mark.parametrize(("status", "message", "words"), WRONG)
def test_wrong_use_is_reported_in_one_line(
    status: int, message: str, words: list[str | Path], modlens: Modlens
) -> None:
    """The line says what is wrong and what to do."""
    check(modlens(*words), status, message)


def test_files_that_cannot_be_read(modlens: Modlens, tmp_path: Path) -> None:
    """Empty, binary fed as text, text of no known form."""
    empty, binary, letter = tmp_path / "empty.hex", tmp_path / "b.bin", tmp_path / "letter.txt"
    empty.touch()
    binary.write_bytes(bytes(range(256)))
    letter.write_text("Dear customer,\nthe meter stopped on Monday.\n" * 20)
    check(modlens("decode", empty), 3, ": empty")
    check(modlens("decode", "-"), 3, "stdin: empty")
    check(modlens("decode", binary, "--from", "hex"), 3, "binary data, not hex text")
    check(modlens("decode", letter), 3, "modlens formats")


def test_a_recording_is_never_replaced(modlens: Modlens, tmp_path: Path) -> None:
    """An export never replaces its own recording, even by another path."""
    path, link = tmp_path / "bus.pcapng", tmp_path / "link.pcapng"
    assert modlens("export", SEED, "-o", path).status == 0
    before = path.read_bytes()
    link.symlink_to(path)
    for read, written in ((path, path), (path, link), (link, path)):
        done = modlens("export", read, "-o", written)
        check(done, 2, f"-o {written}: this is the recording itself; choose another name")
    assert path.read_bytes() == before


@pytest.mark.skipif(sys.platform == "win32", reason="/dev/full")
def test_a_full_disk(modlens: Modlens, tmp_path: Path) -> None:
    """Told by the output's name; the other outputs are whole."""
    full, good = tmp_path / "full.csv", tmp_path / "good.csv"
    full.symlink_to("/dev/full")
    done = modlens("export", SEED, "-o", full, "-o", good)
    check(done, 3, "full.csv: cannot be written: no space left")
    assert good.stat().st_size > 100
    assert sorted(path.name for path in tmp_path.iterdir()) == ["full.csv", "good.csv"]


@pytest.mark.skipif(sys.platform == "win32", reason="/dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize(
    "words", [["decode", SEED, "--to", "csv"], ["decode", SEED], ["formats"], ["explain", "3"]]
)
def test_standard_output_is_full(words: list[str | Path], unbuffered: str) -> None:
    """A full device after standard output is reported, with exit status 3."""
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            command(*words),
            stdout=full,
            stderr=subprocess.PIPE,
            env=environment(PYTHONUNBUFFERED=unbuffered),
            cwd=ROOT,
            check=False,
            timeout=60,
        )
    said = done.stderr.decode()
    assert done.returncode == 3, said
    assert "standard output: cannot be written" in said
    assert "Traceback" not in said


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo terminals")
def test_a_tap_never_overwrites(modlens: Modlens, tmp_path: Path) -> None:
    """A tap refuses an output file that exists, and leaves it unchanged."""
    far, near = os.openpty()
    out, new = tmp_path / "out.csv", tmp_path / "new.csv"
    out.write_text("precious")
    done = modlens("tap", os.ttyname(near), "--line", "9600-8N1", "-o", out)
    check(done, 3, "never overwrites; choose another name")
    assert out.read_text() == "precious"
    assert not new.exists()
    os.close(far)
    os.close(near)
