"""The texts that the core embeds, as plain data, and the spellings that words had before.

What they mean to people is in `dissectors.vocabulary`; a command that exports needs this alone.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from typing import Any, Literal

import _modlens

__all__ = ["Vocabulary", "respelled", "vocabulary"]

Vocabulary = Literal["column", "status", "finding"]


@functools.cache
def vocabulary(part: str) -> Any:
    """A part of the texts of the core, which `_modlens.vocabulary` lists.

    >>> vocabulary("vendors")[0], vocabulary("statuses")[0]["code"]
    ('huawei', 'ok')
    """
    return json.loads(_modlens.vocabulary(part))


def respelled(vocabulary: Vocabulary, word: str) -> str:
    """The current spelling of a word that may have its former one.

    >>> respelled("status", "not_seen"), respelled("status", "ok")
    ('not_observed', 'ok')
    """
    return _renamed().get((vocabulary, word), word)


@functools.cache
def _renamed() -> Mapping[tuple[str, str], str]:
    rows = vocabulary("renamed")
    return {(row["vocabulary"], row["former"]): row["current"] for row in rows}
