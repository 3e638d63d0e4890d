"""The glossary of ARCHITECTURE.md stays short enough to be read, and no term needs itself."""

from __future__ import annotations

import re

from tests.conftest import ROOT
from tests.support.cycles import cycles

MAX_TERMS = 60


def glossary() -> dict[str, tuple[set[str], str]]:
    """By the first word of each row: all words of the row, and what they mean."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    section = text.split("## Glossary\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \|$", section, re.MULTILINE)[2:]
    return {words.split(", ")[0]: (set(words.split(", ")), meaning) for words, meaning in rows}


def test_it_has_at_most_sixty_terms() -> None:
    """More of them nobody learns."""
    terms = [term for words, _ in glossary().values() for term in words]
    assert terms
    assert len(terms) <= MAX_TERMS
    assert len(terms) == len(set(terms))


def test_no_two_terms_explain_each_other() -> None:
    """Each row is understood with those that it names, and these without it."""
    rows = glossary()
    named = {
        term: {
            other
            for other, (words, _) in rows.items()
            if other != term
            and any(re.search(rf"\b{re.escape(word)}s?\b", meaning) for word in words)
        }
        for term, (_, meaning) in rows.items()
    }
    assert not [sorted(group) for group in cycles(named)]
