"""The tool `explain`: what a code or name means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from analyzer.assistants.answers import Row, page, without_empty
from analyzer.assistants.fence import Fence
from analyzer.columns import TABLES, columns
from analyzer.explanations import explain_word
from dissectors.explain import known_words

__all__ = ["answer"]


def answer(_: Fence, arguments: Mapping[str, Any]) -> str:
    """The explanation of a word; of `columns`, a table and `words` the names there are."""
    word, offset = arguments["word"], arguments.get("offset", 0)
    listed = _list(word)
    if listed:
        return page({}, listed[offset:], offset=offset, total=len(listed))
    found = explain_word(word)
    head = {
        "title": found.title,
        "section": found.section or None,
        "text": found.text,
        "example": list(found.example),
    }
    return page(without_empty(head), [], offset=0, total=0)


def _list(word: str) -> list[Row]:
    """The names of all columns, those of a table with their meaning, or all words."""
    if word == "columns":
        names = {table: [column.key for column in columns(table)] for table in TABLES}
        return [("columns", {"table": table, "keys": ",".join(names[table])}) for table in TABLES]
    if word in TABLES:
        return [("columns", {"column": one.key, "help": one.help}) for one in columns(word)]
    return [("words", {"word": one}) for one in known_words()] if word == "words" else []
