"""The recipes of CONTRIBUTING.md, carried out on a copy of the tree.

The line above a block says where it goes: "`FILE`, new:", or "`FILE`, after `LINE`:" (or "in front
of", or "in place of"). A line that is not there exactly once is a mistake in the recipe.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import ROOT
from tests.docs.documents import Block, blocks

DOCUMENT = "CONTRIBUTING.md"
LANGUAGES = ("toml", "rust", "python")
METER = "dissectors/vendor/meter.toml"
_PLACE = re.compile(
    r"`(?P<file>[^`]+)`, (?P<how>new|after|in front of|in place of)(?: `(?P<line>.+)`)?:"
)
_NOT_COPIED = ("target", ".venv", ".git", "dist", "__pycache__", ".*_cache", ".hypothesis", "*.so")


@dataclass(frozen=True, slots=True)
class Step:
    """One block and its place; `how` is new, after, in front of or in place of `line`."""

    file: str
    how: str
    line: str
    text: str


def steps(*languages: str) -> list[Step]:
    """The steps of these languages (all by default), in the order of the document."""
    wanted = languages or LANGUAGES
    found = [(block, _PLACE.fullmatch(block.before)) for name in wanted for block in of(name)]
    places = [(block.line, match, block.text) for block, match in found if match]
    return [
        Step(match["file"], match["how"], match["line"] or "", text)
        for _, match, text in sorted(places, key=lambda place: place[0])
    ]


def of(language: str) -> list[Block]:
    return blocks(DOCUMENT, language)


def place(step: Step, text: str) -> int:
    """The number of the one line of a text that the step means."""
    lines = [number for number, line in enumerate(text.splitlines()) if line.strip() == step.line]
    assert len(lines) == 1, f"{step.file}: {step.line!r} stands there {len(lines)} times"
    return lines[0]


def copy_of_the_tree(folder: Path) -> Path:
    """The checkout without what is built."""
    return Path(shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*_NOT_COPIED)))


def carry_out(step: Step, tree: Path) -> None:
    """Do what the step says."""
    path = tree / step.file
    if step.how == "new":
        assert not path.exists(), path
        path.write_text(step.text, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    at = place(step, text)
    lines = text.splitlines(keepends=True)
    start = at + (step.how == "after")
    lines[start : at + (step.how != "in front of")] = [step.text]
    path.write_text("".join(lines), encoding="utf-8")
