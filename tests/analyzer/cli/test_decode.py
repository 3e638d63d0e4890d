"""`modlens decode` and `export`: recordings to tables and files."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import CAPTURES, ROOT, Modlens, command, environment

SEED = CAPTURES / "seed_rtu" / "recording.hex"
POLLS = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"


def test_the_table_is_for_stdout_and_the_rest_for_stderr(modlens: Modlens) -> None:
    """What was detected, how sure, which clock; the summary at the end."""
    done = modlens("decode", POLLS, "--line", "19200-8E1")
    assert done.status == 0
    assert done.out.splitlines()[0].split()[:2] == ["no.", "time"]
    said = done.err.splitlines()
    assert said[0].startswith(f"{POLLS}: chunks (100 % certain:")
    assert "UTC timestamps, resolution 1 us, mode rtu" in said[0]
    assert " frames (" in said[1]
    assert "transactions: ok" in said[2]


def test_the_zone_that_times_are_read_in_is_named(modlens: Modlens, tmp_path: Path) -> None:
    """With `--timezone`, a log is not said to have times in UTC."""
    path = tmp_path / "day.log"
    path.write_text(
        "2026-11-21 10:00:00.000 TX 01 03 00 00 00 0A C5 CD\n"
        "2026-11-21 10:00:00.050 RX 01 83 02 C0 F1\n",
        encoding="utf-8",
    )
    said = modlens("decode", path, "--timezone", "Europe/Berlin").err
    assert "read as Europe/Berlin where they state no zone" in said
    assert "UTC timestamps" not in said


def test_lines_that_are_not_understood_are_counted_and_shown(
    modlens: Modlens, tmp_path: Path
) -> None:
    """The first three, without what would colour them or move the cursor."""
    path = tmp_path / "bus.hex"
    odd = "".join(f"odd {number}\x1b[2J\n" for number in range(5))
    frames = "01 03 00 00 00 0A C5 CD\n01 83 02 C0 F1\n"
    path.write_text(f"{frames}{odd}")
    done = modlens("decode", path)
    assert done.status == 0
    assert "5 of " in done.err
    assert "lines could not be parsed" in done.err
    assert [line for line in done.err.splitlines() if "odd" in line] == [
        f"  line {number + 3}: odd {number}" for number in range(3)
    ]
    assert modlens("decode", path, "--strict").status == 1


def test_strict_is_about_damage(modlens: Modlens) -> None:
    """Exit status 1 if anything was damaged, and all outputs are there all the same."""
    assert modlens("decode", POLLS, "--strict", "--line", "19200-8E1").status == 0
    assert modlens("decode", DISTURBED).status == 0
    done = modlens("decode", DISTURBED, "--strict")
    assert done.status == 1
    assert len(done.out.splitlines()) > 20


def test_exports_go_to_stdout(modlens: Modlens) -> None:
    """CSV and JSON lines on standard output have the same rows."""
    wanted = ("--table", "frames", "--columns", "frame,unit,hex")
    lines = modlens("decode", DISTURBED, "--to", "jsonl", *wanted).out.splitlines()
    table = modlens("decode", DISTURBED, "--to", "csv", *wanted).out
    rows = list(csv.DictReader(io.StringIO(table, newline="")))
    assert len(rows) == len(lines) > 20
    for line, row in zip(lines, rows, strict=True):
        assert {key: str(value) for key, value in json.loads(line).items()} == {
            key: value for key, value in row.items() if value
        }


def test_several_outputs_in_one_pass(modlens: Modlens, tmp_path: Path) -> None:
    """Each with its table; without --to nothing goes to the screen."""
    outputs = {
        "transactions": tmp_path / "txns.csv",
        "frames": tmp_path / "frames.jsonl",
        "readings": tmp_path / "readings.csv",
        "findings": tmp_path / "findings.jsonl",
    }
    words = [word for name, path in outputs.items() for word in ("-o", f"{name}:{path}")]
    done = modlens("decode", DISTURBED, *words)
    assert done.status == 0
    assert done.out == ""
    for name, path in outputs.items():
        assert path.stat().st_size > 0
        assert f" {name}" in next(line for line in done.err.splitlines() if str(path) in line)
    assert sorted(tmp_path.iterdir()) == sorted(outputs.values())
    both = modlens("decode", DISTURBED, "-o", tmp_path / "again.csv", "--to", "table")
    assert both.out.splitlines()[0].split()[0] == "no."


def test_export_says_nothing(modlens: Modlens, tmp_path: Path) -> None:
    """`export` is for scripts: it prints no messages."""
    path = tmp_path / "out.csv"
    done = modlens("export", POLLS, "-o", path)
    assert (done.status, done.out, done.err) == (0, "", "")
    assert path.read_bytes() == modlens("decode", POLLS, "--to", "csv").out.encode()
    assert modlens("export", POLLS).status == 2


@pytest.mark.parametrize("name", ["recording.hex"])
def test_standard_input_is_a_recording(name: str, modlens: Modlens) -> None:
    """`-` gives the same rows as the file, with another source name."""
    data = SEED.with_name(name).read_bytes()
    columns = ("--to", "csv", "--columns", "txn,unit,address,data,status")
    piped = modlens("decode", "-", *columns, stdin=data)
    assert piped.status == 0
    assert piped.err.startswith("stdin: hex")
    assert piped.out == modlens("decode", SEED, *columns).out


def test_options_of_decoding(modlens: Modlens, tmp_path: Path) -> None:
    """Mode, timeout and vendors' functions reach the core."""
    seen = modlens("decode", POLLS, "--mode", "ascii", "--to", "csv", "--table", "frames")
    assert ",ascii," in seen.out
    assert ",rtu," not in seen.out
    assert modlens("decode", POLLS, "--timeout", "1ms").out != modlens("decode", POLLS).out
    own = tmp_path / "own.toml"
    own.write_text(
        "format = 1\n[[function]]\ncode = 0x41\nname = 'Own Thing'\nsection = 'own'\n"
        "summary = 'own'\nrequest = []\nresponse = ['data:bytes']\noperation = 'other'\n"
        "example = { request = '41', response = '41 01' }\n"
    )
    done = modlens(
        "decode", CAPTURES / "pymodbus_exceptions" / "recording.jsonl",
        "--functions", own, "--to", "csv", "--columns", "function_name",
    )  # fmt: skip
    assert done.err.count("own.toml") == 0
    assert "Own Thing" in done.out


def test_recordings_are_numbered_through(modlens: Modlens) -> None:
    """Each file is a bus; frame and transaction numbers run on."""
    done = modlens("decode", SEED, SEED, "--to", "csv", "--columns", "txn,bus")
    rows = [line.split(",") for line in done.out.split()[1:]]
    assert [int(row[0]) for row in rows] == list(range(1, len(rows) + 1))


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
@pytest.mark.parametrize("to", ["table", "csv"])
def test_a_closed_pipe_ends_quietly(to: str, tmp_path: Path) -> None:
    """`modlens decode ... | head -1`: no traceback, no message; other outputs stay whole."""
    path = tmp_path / "long.bin"
    path.write_bytes(bytes.fromhex("010300000001840a") * 200_000)
    other = tmp_path / "out.csv"
    for more in ([], ["-o", str(other)]):
        running = subprocess.Popen(
            command("decode", path, "--to", to, *more),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment(),
            cwd=ROOT,
        )
        assert running.stdout is not None
        assert running.stderr is not None
        running.stdout.readline()
        running.stdout.close()
        said = running.stderr.read().decode()
        running.stderr.close()
        assert running.wait(60) == 0
        assert "Traceback" not in said
        assert "rror" not in said
        assert ("frames" in said) == bool(more)
    assert other.read_bytes().count(b"\n") == 200_001


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
def test_a_terminal_that_is_gone_harms_no_output(tmp_path: Path) -> None:
    """Nobody can read what is said: the outputs are whole all the same."""
    out = tmp_path / "out.csv"
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        command("decode", POLLS, "-o", out),
        stdout=writing,
        stderr=writing,
        env=environment(),
        cwd=ROOT,
        check=False,
        timeout=60,
    )
    os.close(writing)
    assert done.returncode == 0
    assert out.read_text().count("\n") > 50
