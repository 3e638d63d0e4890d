"""What all tests may use: the command, the recordings, and how to do without a program.

A test that needs a program which is not there is skipped by the program's name. Where `MODLENS_CI`
is 1 everything has been installed, and such a skip is a failure.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]
CAPTURES = ROOT / "captures"
TIMEOUT_S = 120

# Whether a change lands is not left to chance: `make properties` looks for examples that are new.
settings.register_profile("repeated", derandomize=True)
if os.environ.get("MODLENS_CI") == "1":
    settings.load_profile("repeated")

# A run under `nohup`, or in the background of a script, ignores these, and what it starts would
# inherit that.
for name in ("SIGHUP", "SIGQUIT"):
    if signal.getsignal(getattr(signal, name, signal.SIGTERM)) is signal.SIG_IGN:
        signal.signal(getattr(signal, name), signal.SIG_DFL)


@dataclass(frozen=True, slots=True)
class Done:
    """A finished run of the command: its exit status, what it printed, and what it said."""

    status: int
    out: str
    err: str


Modlens = Callable[..., Done]


def environment(**changes: str) -> dict[str, str]:
    """The environment for a run of the command: 80 columns, UTC, no terminal's habits."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in ("COLUMNS", "FORCE_COLOR", "NO_COLOR", "PYTHONUNBUFFERED", "TTY_COMPATIBLE")
    }
    return {**kept, "TZ": "UTC", "PYTHONIOENCODING": "utf-8", **changes}


def command(*words: str | Path) -> list[str]:
    """The words that start `modlens` from this checkout."""
    return [sys.executable, "-m", "analyzer", *(str(word) for word in words)]


@pytest.fixture
def modlens() -> Modlens:
    """Runs `modlens` with some words and standard input to its end."""

    def run(*words: str | Path, stdin: bytes = b"", **changes: str) -> Done:
        done = subprocess.run(
            command(*words),
            input=stdin,
            capture_output=True,
            timeout=TIMEOUT_S,
            env=environment(**changes),
            cwd=ROOT,
            check=False,
        )
        return Done(done.returncode, done.stdout.decode(), done.stderr.decode())

    return run


@pytest.fixture
def captures() -> Path:
    """The folder of the recordings."""
    return CAPTURES


def recording_with(table: str) -> Path:
    """A recording that has rows in this table: connections are in captures of networks only."""
    if table == "connections":
        return CAPTURES / "pymodbus_tcp" / "recording.pcap"
    return CAPTURES / "pymodbus_disturbed" / "recording.jsonl"


def need_program(name: str) -> str:
    """The path of a program; without it the test is skipped by its name, or fails under CI."""
    path = shutil.which(name)
    if path is None:
        without(name)
    return str(path)


def without(what: str) -> None:
    """Skip the running test because something is not there; under CI that is a failure."""
    if os.environ.get("MODLENS_CI") == "1":
        pytest.fail(f"{what} is not there, but under CI it has to be")
    pytest.skip(f"{what} is not there")
