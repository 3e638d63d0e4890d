"""What a terminal gets from formats and commands: nothing that moves its cursor or hides text."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, command, environment

pty = pytest.importorskip("pty")

EVIL = "pump\x1b[2J\u009b31m\u202eexe.\u2066\u061c"
"""Clears the screen, sets a colour by C1, and turns the direction of writing."""

UNSAFE = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200b-\u200f\u202a-\u202e\u2066-\u2069]"
)
EXCHANGE = "2026-11-21T14:03:22.104Z 010300000001840a\n2026-11-21T14:03:22.124Z 0103020007f986\n"


def on_terminal(*words: str | Path) -> str:
    """Run `modlens` with standard output and error on a terminal; what the terminal got."""
    leader, follower = pty.openpty()
    environ = environment(TERM="dumb")  # so that no escape sequence is our own
    running = subprocess.Popen(
        command(*words), stdin=subprocess.DEVNULL, stdout=follower, stderr=follower,
        env=environ, cwd=ROOT,
    )  # fmt: skip
    os.close(follower)
    got = b""
    while True:
        try:
            block = os.read(leader, 65536)
        except OSError:  # EIO is the end on Linux
            break
        if not block:
            break
        got += block
    os.close(leader)
    running.wait(60)
    assert b"Traceback" not in got
    return got.decode()


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A log whose name, and so its bus and source, is evil."""
    path = tmp_path / f"{EVIL}.hex"
    path.write_text(EXCHANGE)
    return path


@pytest.mark.parametrize(
    "form", ["csv", "jsonl", "influx", "zeek", "icsnpp", "md", "txt", "simulator", "table"]
)
def test_no_format_moves_the_cursor(form: str, recording: Path) -> None:
    """Bus and source are escaped on a terminal, whatever the format."""
    got = on_terminal("decode", recording, "--to", form)
    assert got
    assert not UNSAFE.search(got), ascii(got)


@pytest.mark.parametrize(
    "words",
    [("stats",), ("show",), ("map",), ("learn",), ("decode", "--to", "nothing"), ("show", "--txn")],
)
def test_no_command_moves_the_cursor(words: tuple[str, ...], recording: Path) -> None:
    """Commands that read the log, and errors that name it."""
    got = on_terminal(words[0], recording, *words[1:])
    assert got
    assert not UNSAFE.search(got), ascii(got)


def test_files_and_pipes_get_all_but_control_characters(recording: Path, tmp_path: Path) -> None:
    """The name as it is, in the file and through the pipe; a control character would act later."""
    out = tmp_path / "out.csv"
    words = ("export", recording, "--columns", "bus,status")
    piped = subprocess.run(
        command(*words, "--to", "csv", "-o", out),
        capture_output=True, check=True, env=environment(), cwd=ROOT,
    ).stdout  # fmt: skip
    assert str(recording).replace("\x1b", "?") in piped.decode()
    assert out.read_bytes() == piped


@pytest.mark.parametrize("form", ["toml", "csv"])
def test_a_profile_on_a_terminal(form: str, tmp_path: Path) -> None:
    """A profile's texts are escaped on a terminal."""
    path = tmp_path / "evil.csv"
    path.write_text(f"name,address,type\n{EVIL},0,u16\n")
    got = on_terminal("import", "csv", path, "--base", "0", "--to", form)
    assert "pump" in got
    assert not UNSAFE.search(got), ascii(got)


def test_a_closed_standard_error_does_not_cost_the_file(tmp_path: Path) -> None:
    """Nobody reads the notes: the profile is written all the same, and is no message."""
    if sys.platform == "win32":
        pytest.skip("shells of POSIX")
    source, out = tmp_path / "tags.csv", tmp_path / "out.toml"
    source.write_text("name,address,type\nspeed,0,u16\n")
    words = [*command("import", "csv", source, "-o", out)]
    wanted = None
    reading, writing = os.pipe()
    os.close(reading)
    for stderr, shell in ((subprocess.DEVNULL, ""), (writing, ""), (None, "exec 2>&-; ")):
        out.unlink(missing_ok=True)
        script = [*(["sh", "-c", shell + 'exec "$@"', "sh"] if shell else []), *words]
        done = subprocess.run(script, stderr=stderr, check=False, env=environment(), cwd=ROOT)
        assert done.returncode == 0, shell
        wanted = wanted or out.read_bytes()
        assert out.read_bytes() == wanted
    os.close(writing)
    assert wanted is not None
    assert b"speed" in wanted


def test_an_error_keeps_its_status_without_a_reader(tmp_path: Path) -> None:
    """Standard error closed: the message is lost, the status is not."""
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        command("decode", tmp_path / "not_there"),
        stderr=writing, check=False, env=environment(), cwd=ROOT,
    )  # fmt: skip
    os.close(writing)
    assert done.returncode == 3
