"""A signal to an export: the older file stays, what was decoded is beside it."""

from __future__ import annotations

import csv
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from analyzer import decode
from tests.conftest import ROOT, command, environment

if sys.platform == "win32":
    pytest.skip("signals of POSIX", allow_module_level=True)

EXCHANGE = b"010300000001840a\n01030200 07f986\n"
NAMES = ("out.csv", "out.jsonl", "out.parquet", "out.sqlite", "out.pcapng")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def interrupt(number: int, *words: str | Path) -> tuple[int, str]:
    """Send a signal to `modlens decode` while it waits for more; exit status and messages."""
    reading, writing = os.pipe()
    running = subprocess.Popen(
        command("decode", "-", "--from", "hex", *words),
        stdin=reading,
        stderr=subprocess.PIPE,
        env=environment(),
        cwd=ROOT,
    )
    os.close(reading)
    os.write(writing, EXCHANGE)
    assert running.stderr is not None
    first = running.stderr.readline().decode()
    assert first.startswith("stdin: hex")
    time.sleep(0.3)
    running.send_signal(number)
    said = running.stderr.read().decode()
    running.stderr.close()
    os.close(writing)
    assert "Traceback" not in said
    return running.wait(60), said


@pytest.mark.parametrize("number", SIGNALS)
def test_the_old_files_stay_and_the_new_ones_stand_beside_them(number: int, tmp_path: Path) -> None:
    """Every format is a complete file of the one transaction that was decoded."""
    parquet = pytest.importorskip("pyarrow.parquet")
    words: list[str | Path] = []
    for name in NAMES:
        (tmp_path / name).write_bytes(b"old")
        words += ["-o", tmp_path / name]
    status, said = interrupt(number, *words)
    assert status == 128 + number
    partial = {name: tmp_path / f"{name}.partial" for name in NAMES}
    assert {one.name for one in tmp_path.iterdir()} == {
        *NAMES,
        *(path.name for path in partial.values()),
    }
    for name in NAMES:
        assert (tmp_path / name).read_bytes() == b"old"
        assert str(partial[name]) in said
    assert "older files are unchanged" in said
    # The summary follows the message, as docs and records have it.
    assert said.index("interrupted: ") < said.index("1 transaction: ok 1")

    with partial["out.csv"].open(newline="") as lines:
        assert [row["status"] for row in csv.DictReader(lines)] == ["ok"]
    (line,) = partial["out.jsonl"].read_text().splitlines()
    assert json.loads(line)["data"] == [7]
    assert parquet.read_table(partial["out.parquet"]).column("status").to_pylist() == ["ok"]
    with sqlite3.connect(partial["out.sqlite"]) as base:
        assert base.execute("SELECT status FROM transactions").fetchall() == [("ok",)]
    again = decode(partial["out.pcapng"], read_as="pcapng")
    assert [row.status for row in again.transactions] == ["ok"]


def test_without_an_older_file_there_is_none_either(tmp_path: Path) -> None:
    """A script that waits for the name never finds half an export; a second one is replaced."""
    for _ in range(2):
        status, said = interrupt(signal.SIGTERM, "-o", tmp_path / "out.csv")
        assert status == 128 + signal.SIGTERM
        assert f"is in {tmp_path / 'out.csv.partial'}" in said
        assert [one.name for one in tmp_path.iterdir()] == ["out.csv.partial"]
    assert (tmp_path / "out.csv.partial").read_text().count("\n") == 2


def test_partitions_become_a_folder_beside(tmp_path: Path) -> None:
    """The folder as well, takes its name only when it is complete."""
    path = tmp_path / "log.parquet"
    status, _ = interrupt(signal.SIGINT, "-o", path, "--style", "partitions")
    assert status == 128 + signal.SIGINT
    assert [one.name for one in tmp_path.iterdir()] == ["log.parquet.partial"]
    assert len(list(tmp_path.glob("*.partial/date=unknown/bus=*/part-0.parquet"))) == 1


def test_the_end_of_following_is_no_interruption(tmp_path: Path) -> None:
    """`--follow` reads until Ctrl-C, so its output is complete then and has its name."""
    log, out = tmp_path / "bus.hex", tmp_path / "out.csv"
    log.write_bytes(EXCHANGE)
    running = subprocess.Popen(
        command("decode", log, "--from", "hex", "--follow", "-o", out),
        stderr=subprocess.PIPE,
        env=environment(),
        cwd=ROOT,
    )
    assert running.stderr is not None
    running.stderr.readline()
    time.sleep(0.3)
    running.send_signal(signal.SIGINT)
    said = running.stderr.read().decode()
    running.stderr.close()
    running.wait(60)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["bus.hex", "out.csv"]
    assert out.read_text().count("\n") == 2
    assert "partial" not in said
