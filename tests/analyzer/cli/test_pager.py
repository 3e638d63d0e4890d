"""A pager takes what is longer than the screen; a line shows how far a long reading has come."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from analyzer.cli.progress import ProgressLine
from tests.conftest import CAPTURES, ROOT, TIMEOUT_S, command, environment

pty = pytest.importorskip("pty")

DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
LINE = ("--line", "19200-8E1")
SHOWN = b"no_response"


def on_terminal(*words: str | Path, **changes: str) -> tuple[int, bytes]:
    """Run `modlens` on a terminal with colours; its exit status, and what the terminal got."""
    ours, theirs = pty.openpty()
    env = environment(TERM="xterm", **changes)
    with subprocess.Popen(
        command(*words), stdin=theirs, stdout=theirs, stderr=theirs, env=env, cwd=ROOT
    ) as running:
        os.close(theirs)
        got = b""
        while True:
            try:
                block = os.read(ours, 65536)
            except OSError:  # EIO is the end on Linux
                break
            got += block
        os.close(ours)
        return running.wait(TIMEOUT_S), got


@pytest.fixture
def pager(tmp_path: Path) -> Mapping[str, str]:
    """The variable that names a pager; it keeps what it got in the file `paged`."""
    return {"PAGER": f"tee {tmp_path}/paged"}


def paged(folder: Path) -> bytes:
    path = folder / "paged"
    return path.read_bytes() if path.exists() else b""


def test_a_table_goes_through_the_pager(pager: Mapping[str, str], tmp_path: Path) -> None:
    """With colours, in the width of the terminal, and with the summary after it."""
    status, got = on_terminal("decode", DISTURBED, *LINE, **pager)
    assert status == 0
    assert SHOWN in got
    there = paged(tmp_path)
    assert SHOWN in there
    assert b"35 transactions" in there
    assert b"\x1b[" in there


def test_what_fails_is_told_behind_the_output(pager: Mapping[str, str], tmp_path: Path) -> None:
    """An error before the first row comes without a pager; the exit status is the command's."""
    status, got = on_terminal("decode", tmp_path / "no.bin", **pager)
    assert status == 3
    assert b"no.bin" in got
    assert not paged(tmp_path)


@pytest.mark.parametrize(
    "words",
    [
        ("decode", DISTURBED, *LINE, "--no-pager"),
        ("--no-pager", "decode", DISTURBED, *LINE),
        ("export", DISTURBED, *LINE, "--to", "csv"),
    ],
)
def test_where_no_pager_is_wanted(
    words: tuple[str | Path, ...], pager: Mapping[str, str], tmp_path: Path
) -> None:
    """By the option, in either place, and for a command whose output is not for people."""
    status, got = on_terminal(*words, **pager)
    assert status == 0
    assert SHOWN in got
    assert not paged(tmp_path)


@pytest.mark.parametrize("changes", [{"PAGER": ""}, {"PAGER": "cat"}, {"PAGER": "no-such-pager"}])
def test_without_a_pager_the_output_is_the_terminals(changes: Mapping[str, str]) -> None:
    """None, one that does nothing, and one that is not there."""
    status, got = on_terminal("decode", DISTURBED, *LINE, **changes)
    assert status == 0
    assert SHOWN in got


def test_a_pipe_gets_no_pager(pager: Mapping[str, str], tmp_path: Path) -> None:
    """Only a terminal can be filled."""
    done = subprocess.run(
        command("decode", DISTURBED, *LINE),
        capture_output=True, timeout=TIMEOUT_S, env=environment(TERM="xterm", **pager), check=True,
    )  # fmt: skip
    assert SHOWN in done.stdout
    assert not paged(tmp_path)


def test_a_reader_who_leaves_ends_the_command() -> None:
    """As the reader of a pipe does: no error, status 0."""
    status, got = on_terminal("decode", DISTURBED, *LINE, PAGER="head -n 3")
    assert status == 0
    assert b"Traceback" not in got
    assert b"Broken" not in got


SLOW = """
import sys
sys.path.insert(0, %r)
import analyzer.cli.progress as progress
progress.FIRST_S = progress.INTERVAL_S = 0.0
from analyzer.cli import main
sys.exit(main(%r))
"""


def test_the_progress_is_told_and_wiped_away() -> None:
    """Share, rate and time left on the terminal; at the end nothing of it is left."""
    words = ["stats", str(DISTURBED), *LINE, "--no-pager"]
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", SLOW % (str(ROOT), words)],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=theirs,
        env=environment(TERM="xterm"), cwd=ROOT,
    ) as running:  # fmt: skip
        os.close(theirs)
        running.communicate(timeout=TIMEOUT_S)
    got = os.read(ours, 65536).decode()
    os.close(ours)
    assert "100 % of " in got
    assert "/s, 0 s left" in got
    assert got.rpartition("left")[2].startswith("\r\x1b[K")


def test_no_progress_but_on_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """A log file gets no line that is drawn again and again."""
    line = ProgressLine()
    line.advance(1, 2)
    line.wipe()
    assert capsys.readouterr().err == ""
