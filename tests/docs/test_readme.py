"""Runs the commands of the README and compares its pictures with what the program prints."""

from __future__ import annotations

import os
import pty
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

import _modlens
from docs.make import moving_picture
from tests.conftest import ROOT, TIMEOUT_S, command, environment
from tests.docs.documents import (
    COLUMNS,
    Block,
    blocks,
    shell,
    shell_environment,
    text_of,
)
from tests.support.printed import printed

README = "README.md"
SHOWN = 7
"""Rows of what the demo prints; the others are left out."""

LINES = [line for block in blocks(README, "sh") for line in block.text.splitlines()]
TAPS = [line for line in LINES if line.startswith("modlens tap")]
RUNS = [line for line in LINES if line not in TAPS]
PORT = re.compile(r"/dev/ttyUSB\d")


def test_the_commands_of_the_readme_are_all_commands() -> None:
    """Nothing in a block for the shell that the tests here would not run."""
    assert all(line.startswith("modlens ") for line in LINES)
    assert {line.split()[1] for line in LINES} == {"tap", "doctor", "report"}


@pytest.mark.parametrize("line", RUNS)
def test_a_command_works_as_written(line: str, tmp_path: Path) -> None:
    """Typed in a folder that has the recordings; every file that it names is written."""
    done = shell(line, cwd=tmp_path, env=shell_environment(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "not understood" not in done.stderr
    outputs = re.findall(r"-o (?:\w+:)?(\S+)", line)
    assert all((tmp_path / name).stat().st_size for name in outputs)
    assert bool(done.stdout) == (not outputs)


@pytest.mark.parametrize("line", TAPS)
def test_a_tap_works_as_written(line: str, tmp_path: Path) -> None:
    """The ports are pseudo terminals; each transaction on them becomes a row."""
    names = PORT.findall(line)
    ends = {name: pty.openpty() for name in names}
    for name, (_, port) in ends.items():
        line = line.replace(name, os.ttyname(port))
    line = line.replace(" --where \"status != 'ok'\"", "")  # what is sent here is sound
    running = subprocess.Popen(
        ["sh", "-c", f"exec {line}"],
        cwd=tmp_path, env=shell_environment(tmp_path),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert running.stderr is not None
        assert "listening" in running.stderr.readline()
        for name, part in zip((names[0], names[-1]), exchange(), strict=True):
            os.write(ends[name][0], part)
            time.sleep(0.3)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=TIMEOUT_S)
    finally:
        running.kill()
        for pair in ends.values():
            for end in pair:
                os.close(end)
    assert "555 0 100" in out, err
    assert "1 transaction: ok 1" in err
    for name in re.findall(r"-o (\S+)", line):
        assert "555 0 100" in (tmp_path / name).read_text()


def exchange() -> list[bytes]:
    """The request and the response of the specification's example for function 3."""
    bodies = [bytes.fromhex("1103006b0003"), bytes.fromhex("110306022b00000064")]
    return [body + _modlens.crc16(body).to_bytes(2, "little") for body in bodies]


def picture() -> Block:
    """The block that shows what `make demo` prints."""
    return next(block for block in blocks(README, "console") if "modlens decode" in block.text)


def on_a_terminal(words: list[str]) -> str:
    """What a terminal of 80 columns without colours shows of a command, tables and notes alike."""
    env = environment(NO_COLOR="1", TERM="xterm", PAGER="cat")
    shown, status = printed(words, env, cwd=ROOT, lines=60, columns=COLUMNS)
    assert status == 0
    return re.sub(r"\x1b\[[0-9;]*m", "", shown)


def pictured(screen: str) -> str:
    """A screen as the README shows it: lines as a terminal breaks them, some rows left out."""
    lines = [
        line[start : start + COLUMNS].rstrip()
        for line in screen.splitlines()
        for start in range(0, max(len(line), 1), COLUMNS)
    ]
    rows = [number for number, line in enumerate(lines) if re.match(r" *\d+ \d\d:", line)]
    left_out = rows[SHOWN:]
    lines[left_out[0] : left_out[-1] + 1] = [f"     ... {len(left_out)} more rows"]
    return "".join(f"{line}\n" for line in lines)


def test_the_picture_is_what_the_demo_prints() -> None:
    """All of it, but for the rows that it says are left out.

    Where the demo has changed with good reason: MODLENS_UPDATE=1 writes it into the README.
    """
    prompt, _, shown = picture().text.partition("\n")
    words = prompt.removeprefix("$ modlens ").split()
    assert f"$(BIN)/modlens {' '.join(words)}\n" in text_of("Makefile")
    real = pictured(on_a_terminal(command(*words)))
    if os.environ.get("MODLENS_UPDATE") == "1":
        (ROOT / README).write_text(text_of(README).replace(shown, real), encoding="utf-8")
        shown = real
    assert shown == real


def test_the_moving_picture_is_what_the_program_prints() -> None:
    """Compares the words of each scene; times and other numbers differ from run to run.

    One of the scenes is live: on a busy machine its tap may find the settings some rows later, so
    that it is played again.
    """
    shown = moving_picture.words_in(moving_picture.PICTURE.read_text(encoding="utf-8"))
    assert len(shown) == 3
    for _ in range(3):
        real = moving_picture.words_in(moving_picture.drawn(moving_picture.scenes()))
        if shown == real:
            break
    assert shown == real


@pytest.mark.parametrize(
    "document", ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md"]
)
def test_links_lead_somewhere(document: str) -> None:
    """Every relative link is a file of the checkout, every `make` word a target."""
    text = text_of(document)
    for target in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (ROOT / target).exists(), target
    targets = set(re.findall(r"^([a-z-]+):", text_of("Makefile"), re.MULTILINE))
    for name in re.findall(r"(?:^ *|`|\$ )make ([a-z-]+)", text, re.MULTILINE):
        assert name in targets, name
