"""Completion and manual pages say what the parsers say, and shells understand them."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from analyzer.cli import COMMANDS
from release.options import Command, commands
from release.shell_files import FOLDER, files
from tests.conftest import TIMEOUT_S, need_program

BASH = "bash-completion/completions/modlens"
COMPLETE = """
source "$0"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
_modlens; printf '%s\\n' "${COMPREPLY[@]}"
"""


def completions(*words: str, cwd: Path) -> list[str]:
    """What bash offers for the last word."""
    run = [need_program("bash"), "-c", COMPLETE, str(FOLDER / BASH), "modlens", *words]
    done = subprocess.run(
        run, cwd=cwd, capture_output=True, text=True, check=True, timeout=TIMEOUT_S
    )
    assert not done.stderr
    return done.stdout.split()


def test_the_files_are_those_of_the_parsers() -> None:
    """Where an option has changed: make shell-files."""
    there = {
        path.relative_to(FOLDER).as_posix(): path.read_text(encoding="utf-8")
        for path in FOLDER.rglob("*")
        if path.is_file()
    }
    assert there == files()


def test_bash_completes_commands_and_files(tmp_path: Path) -> None:
    """In the first place both, because `modlens FILE` decodes."""
    (tmp_path / "decoded.bin").touch()
    assert completions("dec", cwd=tmp_path) == ["decode", "decoded.bin"]
    assert set(COMMANDS) <= set(completions("", cwd=tmp_path))


@pytest.mark.parametrize("command", commands(), ids=lambda one: one.name)
def test_bash_completes_every_option(command: Command, tmp_path: Path) -> None:
    """All options of each command, after other words too."""
    wanted = [flag for flag in command.flags if flag.startswith("--")]
    assert completions(command.name, "x", "--", cwd=tmp_path) == wanted


def test_bash_completes_values(tmp_path: Path) -> None:
    """Choices, files, and nothing where nothing is known."""
    (tmp_path / "out.csv").touch()
    assert completions("decode", "--mode", "", cwd=tmp_path) == ["auto", "rtu", "ascii", "tcp"]
    assert completions("decode", "-o", "o", cwd=tmp_path) == ["out.csv"]
    assert completions("decode", "--where", "", cwd=tmp_path) == []
    assert completions("tap", "--view", "h", cwd=tmp_path) == ["health"]


@pytest.mark.parametrize(
    ("shell", "name"),
    [("zsh", "zsh/site-functions/_modlens"), ("fish", "fish/vendor_completions.d/modlens.fish")],
)
def test_other_shells_understand_theirs(shell: str, name: str) -> None:
    """The shell parses its script."""
    done = subprocess.run(
        [need_program(shell), "-n", str(FOLDER / name)],
        capture_output=True, text=True, check=False, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_manual_page_names_every_option(name: str) -> None:
    """Each option with its explanation, and no line that troff would take for a request."""
    (command,) = (one for one in commands() if one.name == name)
    text = files()[f"man/man1/modlens-{name}.1"]
    for flag in command.flags:
        escaped = flag.replace("-", "\\-")
        assert rf"\fB{escaped}\fR" in text
    requests = {line.split()[0] for line in text.splitlines() if line.startswith((".", "'"))}
    assert requests <= {".TH", ".SH", ".TP", ".B", ".BR", ".nf", ".fi", '.\\"'}


def test_man_shows_the_pages() -> None:
    """No warning from the formatter that man uses, which also is a check of the syntax."""
    program = need_program("mandoc")
    pages = [str(FOLDER / name) for name in files() if name.startswith("man/")]
    done = subprocess.run(
        [program, "-T", "lint", "-W", "error", *pages],
        capture_output=True, text=True, check=False, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "")
