"""Findings are discovered in one folder of the engine, and their details are worded in one file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import _modlens
from tests.conftest import ROOT
from tests.support.rust_tokens import tokens, without_tests

CRATES = ROOT / "crates"
FOLDER = CRATES / "modlens-engine" / "src" / "findings"
WORDS = FOLDER / "words.rs"
DISCOVERING = sorted(path for path in FOLDER.glob("*.rs") if path != WORDS)


def named(path: Path) -> Iterator[str]:
    """The findings (`Finding::Retry`) that a source names, its tests left out."""
    words = [token.text for token in without_tests(tokens(path.read_text("utf-8")))]
    for word, colons, name in zip(words, words[1:], words[2:], strict=False):
        if word == "Finding" and colons == "::" and re.match("[A-Z][a-z]", name):
            yield name


@pytest.mark.parametrize("crate", ["modlens-engine", "modlens-readers", "modlens-profiles"])
def test_no_other_file_makes_findings(crate: str) -> None:
    """The other files report facts, which the files of the folder turn into findings."""
    files = (path for path in (CRATES / crate / "src").rglob("*.rs") if path.parent != FOLDER)
    found = {str(path.relative_to(CRATES)): sorted(set(named(path))) for path in files}
    assert not {path: names for path, names in found.items() if names}


@pytest.mark.parametrize("path", DISCOVERING, ids=lambda path: path.name)
def test_no_other_file_words_details(path: Path) -> None:
    """Strings are made in `words.rs` only."""
    words = {token.text for token in without_tests(tokens(path.read_text("utf-8")))}
    assert not words.intersection(("format", "to_string", "to_owned"))


def test_every_finding_is_discovered() -> None:
    """A finding that is declared but never discovered would be documented in vain."""
    discovered = {name for path in DISCOVERING for name in named(path)}
    declared = re.findall(
        r"^    ([A-Z]\w+) \"\w+\" (?:Info|Warning|Error)$",
        (CRATES / "modlens-protocol" / "src" / "finding.rs").read_text("utf-8"),
        re.MULTILINE,
    )
    assert len(declared) == len(json.loads(_modlens.vocabulary("findings")))
    assert discovered == set(declared)
