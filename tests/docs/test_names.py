"""What the documents for developers quote is in the code: files, types, functions, rows."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import ROOT

FOLDERS = ("crates", "analyzer", "dissectors", "modlens", "tests", "bench", "docs/make", "release")
SUFFIXES = {".rs", ".py", ".toml", ".json"}
_FENCED = re.compile(r"```.*?```", re.DOTALL)
_QUOTED = re.compile(r"`([^`\n]+)`")
_COMMENT = re.compile(r"//.*")
_NAME = re.compile(r"[A-Za-z_]\w*")


def quoted(document: str) -> set[str]:
    """What is between backquotes in the running text and in tables."""
    return set(_QUOTED.findall(_FENCED.sub("", document)))


@cache
def code() -> tuple[str, frozenset[str]]:
    """The code without the comments of Rust, names of files included; and the words in it."""
    texts = []
    for path in (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*"))):
        texts.append(str(path.relative_to(ROOT)))
        if path.suffix in SUFFIXES and path != Path(__file__):
            text = path.read_text("utf-8")
            texts.append(_COMMENT.sub("", text) if path.suffix == ".rs" else text)
    whole = "\n".join(texts)
    return whole, frozenset(_NAME.findall(whole))


def is_in_code(name: str) -> bool:
    """Whether the code has this text, or every name of which it is made."""
    whole, words = code()
    parts = _NAME.findall(name)
    return name in whole or (bool(parts) and words.issuperset(parts))


@pytest.mark.parametrize("document", ["docs/segmentation.md"])
def test_names_are_those_of_the_code(document: str) -> None:
    """A renamed function or weight is renamed in the document as well."""
    names = quoted((ROOT / document).read_text("utf-8"))
    assert len(names) > 100
    assert sorted(name for name in names if not is_in_code(name)) == []


def test_a_former_name_is_found() -> None:
    """The check distinguishes names that there are from names that there are not."""
    assert is_in_code("rtu::search")
    assert not is_in_code("no_such" + "_function_of_the_search")
