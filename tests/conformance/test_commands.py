"""Every command has its module and its help."""

from __future__ import annotations

import importlib
import re

import pytest

from analyzer.cli import COMMANDS, module_of
from tests.conftest import ROOT, Modlens


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_help(name: str, modlens: Modlens) -> None:
    """What it does, and its options, each explained, in 80 columns."""
    done = modlens(name, "--help")
    assert done.status == 0
    assert done.out.startswith(f"usage: modlens {name} ")
    assert COMMANDS[name] in " ".join(done.out.split())
    assert max(map(len, done.out.splitlines())) <= 80


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_is_a_module(name: str) -> None:
    """Of its name, with the two functions that every command has."""
    module = importlib.import_module(module_of(name))
    assert callable(module.add_arguments)
    assert callable(module.run)
    assert str(module.__doc__).startswith(f"`modlens {name}`")


def test_no_command_is_forgotten() -> None:
    """Every module that is a command is in the registry."""
    folder = ROOT / "analyzer" / "cli"
    commands = {
        path.stem
        for path in folder.glob("*.py")
        if re.search(r"^def add_arguments\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert commands == {module_of(name).rpartition(".")[2] for name in COMMANDS}
