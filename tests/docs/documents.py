"""The documents as tests read them: fenced blocks, and a terminal to try commands in."""

from __future__ import annotations

import contextlib
import doctest
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import ROOT, TIMEOUT_S, environment

COLUMNS = 80
_FENCE = re.compile(r"```(\w*)")


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: its language, its text, the last line of text before it, and its place."""

    language: str
    text: str
    before: str
    line: int


def blocks(document: str, language: str) -> list[Block]:
    """The blocks of one language in a document of the root folder."""
    return [block for block in _blocks(text_of(document)) if block.language == language]


def try_examples(document: str) -> tuple[int, int]:
    """How many examples in Python a document has, and how many failed.

    All blocks are tried in turn, in one session, at the root of the checkout.
    """
    text = "".join(block.text for block in blocks(document, "python"))
    example = doctest.DocTestParser().get_doctest(text, {}, document, document, 0)
    runner = doctest.DocTestRunner()
    with contextlib.chdir(ROOT):
        runner.run(example)
    return len(example.examples), runner.summarize().failed


def text_of(document: str) -> str:
    return (ROOT / document).read_text(encoding="utf-8")


def _blocks(text: str) -> Iterator[Block]:
    before, language, start = "", "", 0
    inside: list[str] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        fence = _FENCE.fullmatch(line)
        if inside is not None and line == "```":
            yield Block(language, "".join(f"{one}\n" for one in inside), before, start)
            inside = None
        elif inside is not None:
            inside.append(line)
        elif fence:
            inside, language, start = [], fence[1], number + 1
        elif line.strip():
            before = line.strip()


def shell_environment(home: Path) -> dict[str, str]:
    """`modlens` is this checkout's, called from another folder, which has the recordings."""
    for folder in ("captures", "docs"):
        (home / folder).symlink_to(ROOT / folder)
    programs = home / "bin"
    programs.mkdir()
    command = programs / "modlens"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m analyzer "$@"\n')
    command.chmod(0o755)
    env = environment(COLUMNS=str(COLUMNS), PYTHONPATH=str(ROOT))
    return {**env, "PATH": f"{programs}:{env['PATH']}"}


def shell(line: str, *, cwd: Path, env: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    """The result of a command line in a document."""
    return subprocess.run(
        ["sh", "-c", line],
        cwd=cwd, env=env, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip


def rows_of_table(document: str, head: str) -> list[list[str]]:
    """The cells of the table whose first line begins with `head`, without head and rule."""
    lines = text_of(document).splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith(head)) + 2
    rows = []
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split(" | ")])
    return rows
