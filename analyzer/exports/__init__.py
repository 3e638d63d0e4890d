"""Files that other programs read. One registry: suffix -> the module of its format.

A format is a file of its own with a class `Format`, which turns tables into bytes and knows nothing
of files; where the bytes go is the business of output.py. To add a format: write its module, name
it here.

>>> format_of("frames.csv")
'csv'
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import PurePath
from typing import Protocol, cast

import _modlens
from dissectors.errors import UsageError
from dissectors.words import near

__all__ = ["FORMATS", "Format", "format_of", "load"]

FORMATS = {
    "csv": "analyzer.exports.csv",
    "jsonl": "analyzer.exports.jsonl",
}
"""Suffix without its dot -> module."""


class Format(Protocol):
    """Turns tables of one kind into the bytes of one file, in order."""

    def __init__(self, columns: Sequence[str]) -> None:
        """`columns` are the keys of the columns, in order."""

    def rows(self, table: _modlens.Table) -> bytes:
        """The bytes of some more rows.

        The first call, which may bring none, also gives what stands in front.
        """


def load(name: str) -> type[Format]:
    """The format of that name; `UsageError` with the known ones otherwise."""
    if name not in FORMATS:
        hint = near(name, FORMATS)
        question = f"did you mean {hint!r}?" if hint else f"there are {', '.join(FORMATS)}"
        raise UsageError(f"no format {name!r} to write; {question}")
    return cast(type[Format], importlib.import_module(FORMATS[name]).Format)


def format_of(path: str) -> str:
    """The format that a file's suffix says; `UsageError` if it says none."""
    suffix = PurePath(path).suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        known = ", ".join(f".{name}" for name in FORMATS)
        raise UsageError(f"-o {path}: the suffix says what to write; it is one of {known}")
    return suffix
