"""Habits of the shell: a file or a port instead of a command, the version, a limit of rows."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import CAPTURES, Modlens, command

DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"


def test_a_file_is_decoded(modlens: Modlens, tmp_path: Path) -> None:
    """With any option of `decode`; a name that is no file is reported as one."""
    assert (
        modlens(DISTURBED, "--where", "ok").out == modlens("decode", DISTURBED, "--where", "ok").out
    )
    done = modlens(tmp_path / "no.bin")
    assert done.status == 2
    assert "no such file" in done.err


@pytest.mark.skipif(sys.platform != "linux", reason="the port is a pty")
def test_a_port_is_tapped() -> None:
    """A character device is a port."""
    far, near = os.openpty()
    words = command(os.ttyname(near), "--line", "19200-8E1", "--duration", "0.3s")
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    os.close(far)
    os.close(near)
    assert done.returncode == 0
    assert "listening to" in done.stderr


def test_the_version_is_a_word_too(modlens: Modlens) -> None:
    """As `--version` says it."""
    assert modlens("version").out == modlens("--version").out


def test_a_limit_holds_for_each_output(modlens: Modlens, tmp_path: Path) -> None:
    """The table, files in rows and captures; the first rows are those without a limit."""
    every = modlens("export", DISTURBED, "--to", "csv").out.splitlines()
    some = modlens("export", DISTURBED, "--to", "csv", "--limit", "7").out.splitlines()
    assert some == every[:8]
    outputs = [f"{tmp_path}/x.csv", f"frames:{tmp_path}/f.jsonl", f"{tmp_path}/x.pcapng"]
    words = [word for output in outputs for word in ("-o", output)]
    assert modlens("export", DISTURBED, *words, "--limit", "3").status == 0
    assert (tmp_path / "x.csv").read_text(encoding="utf-8").splitlines() == every[:4]
    assert len((tmp_path / "f.jsonl").read_text(encoding="utf-8").splitlines()) == 3
    again = modlens("export", tmp_path / "x.pcapng", "--to", "csv", "--columns", "txn").out
    assert again.splitlines() == ["txn", "1", "2", "3"]


def test_a_limit_counts_the_rows_that_a_filter_keeps(modlens: Modlens) -> None:
    """The filter first, as in SQL."""
    words = ["export", DISTURBED, "--to", "csv", "--columns", "status"]
    done = modlens(*words, "--where", "no_response", "--limit", "2")
    assert done.out.splitlines() == ["status", "no_response", "no_response"]
    assert modlens(*words, "--limit", "0").status == 2
