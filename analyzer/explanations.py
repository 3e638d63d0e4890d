"""Explains what `dissectors.explain` knows, and the columns of the tables."""

from __future__ import annotations

import _modlens
from analyzer.columns import TABLES, columns
from dissectors.errors import UsageError
from dissectors.explain import Explanation, explain
from dissectors.texts import respelled

__all__ = ["explain_word"]


def explain_word(word: str, source: _modlens.Functions | None = None) -> Explanation:
    """What a word means: a code or a name, otherwise a column of one or several tables.

    `UsageError` for a word without a meaning.

    >>> explain_word("waited_us").text[0]
    "transactions: end of an unanswered request to the master's next request (us)"
    """
    try:
        return explain(word, source=source)
    except UsageError:
        key = respelled("column", word)
        there = [(name, one) for name in TABLES for one in columns(name) if one.key == key]
        if not there:
            raise
    text = tuple(f"{name}: {one.help} ({one.type})" for name, one in there)
    return Explanation("column", f"{key} (column)", "", text)
