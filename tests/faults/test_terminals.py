"""No text from a recording, a device, a name of a file or a profile takes over the terminal."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, Modlens, environment
from tests.faults.hostile_inputs import HOSTILE, make

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="cases are forks of a process")


def test_every_format_and_command_on_a_terminal(tmp_path: Path) -> None:
    """ESC, C1, bidirectional marks in every input: none reaches the terminal of any command."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults.terminal_walk", str(tmp_path)],
        cwd=ROOT, env=environment(TERM="dumb"), capture_output=True, text=True, timeout=240,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith(" cases, 0 fell\n"), done.stdout


def test_files_keep_every_character(tmp_path: Path, modlens: Modlens) -> None:
    """The name of an interface: exactly in JSON, without control characters in CSV."""
    capture = make(tmp_path)["pcapng"]
    rows, table = tmp_path / "rows.jsonl", tmp_path / "rows.csv"
    done = modlens("export", capture, "-o", rows, "-o", table, "--columns", "bus,status")
    assert done.status == 0, done.err
    assert json.loads(rows.read_text().split("\n")[0])["bus"] == HOSTILE
    harmless = re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]", "?", HOSTILE)
    assert harmless.encode() in table.read_bytes()
