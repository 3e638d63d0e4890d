"""`--follow` reads a log that is rotated: what was written just before the rename as well."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.conftest import command, environment

if sys.platform == "win32":
    pytest.skip("an open file cannot be renamed", allow_module_level=True)

ROTATIONS = 20


def request(number: int) -> str:
    """A line of a log: the frame of a unit that has this number."""
    return f"{number:02X} 03 00 00 00 01\n"


def test_what_was_written_before_a_rename_is_read(tmp_path: Path) -> None:
    """A line, the rename, the new file: at once, as logrotate does it, twenty times."""
    log, rows = tmp_path / "bus.log", tmp_path / "rows.csv"
    log.write_text("# a log\n" + request(1))
    running = subprocess.Popen(
        command("decode", log, "--from", "hex", "--follow", "-o", f"frames:{rows}"),
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, env=environment(),
    )  # fmt: skip
    time.sleep(1.5)
    for turn in range(ROTATIONS):
        with log.open("a") as old:
            old.write(request(10 + turn))
            old.flush()
            log.rename(tmp_path / f"bus.log.{turn}")
            log.touch()
            # The writer has not opened the new file yet.
            old.write(request(40 + turn))
        time.sleep(0.15)
        with log.open("a") as new:
            new.write(request(70 + turn))
        time.sleep(0.35)
    time.sleep(1.0)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    text = rows.read_text()
    wanted = [base + turn for turn in range(ROTATIONS) for base in (10, 40, 70)]
    missing = [number for number in wanted if f"{number:02x}0300000001" not in text]
    assert not missing, (missing, said.decode())
