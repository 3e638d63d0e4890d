"""Starting: help, versions, and how long it takes."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

import _modlens
from analyzer.cli import COMMANDS, main
from tests.conftest import ROOT, Modlens, command, environment

BUDGET_S = 0.080
HEAVY = ("rich", "serial", "scapy", "argparse", "_modlens")


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"], ["help"]])
def test_help_lists_the_commands(words: list[str], modlens: Modlens) -> None:
    """Every command is listed with a summary."""
    done = modlens(*words)
    assert done.status == 0
    for name, summary in COMMANDS.items():
        assert f"  {name} " in done.out
        assert summary in done.out


def test_help_for_a_command(modlens: Modlens) -> None:
    """`help COMMAND` and `COMMAND --help` print the same."""
    assert modlens("help", "decode").out == modlens("decode", "--help").out


def test_the_version(modlens: Modlens) -> None:
    """The command and the core have one version, which `--version` prints."""
    assert modlens("--version").out == f"modlens {_modlens.__version__}\n"


def test_main_can_be_called(capsys: pytest.CaptureFixture[str]) -> None:
    """By a program, with words; it gives the exit status."""
    assert main(["explain", "3"]) == 0
    assert main(["explain", "florb"]) == 2
    assert "florb" in capsys.readouterr().err


def test_help_loads_nothing_heavy() -> None:
    """Neither the screen nor a port nor a capture library, nor the core."""
    code = f"""
import sys
from analyzer.cli import main
main(["--help"])
print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT, env=environment(), capture_output=True, check=True, timeout=60,
    )  # fmt: skip
    assert done.stderr.decode().strip() == "[]"


def test_help_is_quick() -> None:
    """Within 80 ms over a bare interpreter; the best of several, for the machine has other work."""

    def best(words: list[str]) -> float:
        times = []
        for _ in range(9):
            start = time.perf_counter()
            subprocess.run(words, cwd=ROOT, env=environment(), capture_output=True, check=True)
            times.append(time.perf_counter() - start)
        return min(times)

    assert best(command("--help")) - best([sys.executable, "-c", "pass"]) < BUDGET_S
