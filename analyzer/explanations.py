"""Explains what `dissectors.explain` knows, and the columns of the tables."""

from __future__ import annotations

from collections.abc import Mapping

import _modlens
from analyzer.columns import TABLES, columns
from dissectors import vocabulary
from dissectors.errors import UsageError
from dissectors.explain import Explanation, explain
from dissectors.table import functions
from dissectors.texts import respelled

__all__ = ["TITLES", "WordGroups", "explain_word", "word_groups"]

WordGroups = Mapping[str, Mapping[str, str]]
"""Title of a group -> its names, each with one line on what it is."""

_MOST_RELATED, _SHORTEST = 5, 3
_CODES = 5
"""Groups with the names of codes, which come last among related names."""

_SYNONYMS = {"crc": "checksum", "lrc": "checksum", "latency": "response time", "delay": "late"}


def word_groups(source: _modlens.Functions | None = None) -> WordGroups:
    """Returns all names that `explain_word` knows, by kind.

    >>> word_groups()["exceptions"]["Illegal Function"]
    'the server does not support this function, or not in its current state'
    """
    return {
        "functions": {row.label: row.summary for row in functions(source)},
        "exceptions": _names("exceptions"),
        "sub-functions of Diagnostics": _names("diagnostics"),
        "MEI types": _names("mei_types"),
        "objects of Read Device Identification": _names("object_ids"),
        "findings": {one.code: one.title for one in vocabulary.findings()},
        "diagnoses of modlens doctor": {one.code: one.title for one in vocabulary.diagnoses()},
        "statuses of transactions": dict(vocabulary.statuses()),
        "verdicts of frames": dict(vocabulary.verdicts()),
        "columns": {one.key: one.help for name in TABLES for one in columns(name)},
    }


def _names(kind: vocabulary.Kind) -> dict[str, str]:
    return {entry.name: entry.meaning for entry in vocabulary.names(kind)}


def _related(word: str) -> list[str]:
    """Returns names that have to do with a word that is none: those that contain it first."""
    wanted = word.casefold().replace("_", " ").removesuffix("s").replace("retrie", "retry")
    wanted = _SYNONYMS.get(wanted, wanted)
    if len(wanted) < _SHORTEST:
        return []
    groups = list(word_groups().values())
    entries = [
        (name, text)
        for group in (*groups[_CODES:], *groups[:_CODES])
        for name, text in group.items()
    ]
    named = [name for name, _ in entries if wanted in name.casefold().replace("_", " ")]
    described = [name for name, text in entries if wanted in text.casefold()]
    return list(dict.fromkeys((*named, *described)))[:_MOST_RELATED]


TITLES = {
    "margin": (
        "how close a unit is to its limit: the response time that 99 % of its answers stay below"
        " (p99), against the time after which the master gives up (timeout)"
    ),
    "measured": (
        "answers whose response time is known; for the others the recording's clock is too coarse"
    ),
}
"""Titles in tables of the doctor and of statistics that are no columns of rows."""


def explain_word(word: str, source: _modlens.Functions | None = None) -> Explanation:
    """What a word means: a code or a name, otherwise a column of one or several tables.

    `UsageError` for a word without a meaning.

    >>> explain_word("waited_us").text[0]
    "transactions: end of an unanswered request to the master's next request (us)"
    """
    try:
        return explain(word, source=source)
    except UsageError as error:
        if word.casefold() in TITLES:
            title = word.casefold()
            return Explanation("column", f"{title} (of a table)", "", (TITLES[title],))
        key = respelled("column", word)
        there = [(name, one) for name in TABLES for one in columns(name) if one.key == key]
        if not there and (related := [] if "did you mean" in error.message else _related(word)):
            names = ", ".join(related)
            raise UsageError(f"no such code or name: {word!r}; related are {names}") from None
        if not there:
            raise
    text = tuple(f"{name}: {one.help} ({one.type})" for name, one in there)
    return Explanation("column", f"{key} (column)", "", text)
