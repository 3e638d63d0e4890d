"""Finds functions by what users write: a code (3, 0x03, fc3) or a name, exact or similar.

>>> find_function("Read Holding Registers").code, find_function("fc 0x10").code
(3, 16)
>>> find_function("Return Bus Message Count")
FunctionChoice(code=8, preset={'sub_function': 11})
>>> find_function("read coil")
Traceback (most recent call last):
...
modlens.UsageError: no function 'read coil'; did you mean 'Read Coils'?
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import _modlens
from dissectors import vocabulary
from dissectors.errors import UsageError
from dissectors.table import functions

__all__ = ["FunctionChoice", "find_function", "normalized", "parse_number", "similar_name"]

DIAGNOSTICS = 0x08
HIGHEST_CODE = 127

_NUMBER = re.compile(r"0x(?P<hex>[0-9a-f]+)|(?P<suffixed>[0-9][0-9a-f]*)h|(?P<decimal>[0-9]+)")
_CODE = re.compile(r"(?:fc|function(?:\s+code)?)?\s*(0x[0-9a-f]+|[0-9][0-9a-f]*h|[0-9]+)")


@dataclass(frozen=True, slots=True)
class FunctionChoice:
    """A function code, and the leading field's value where a name stands for a sub-function."""

    code: int
    preset: dict[str, int] = field(default_factory=dict, hash=False)


def parse_number(text: str) -> int | None:
    """Parse `107`, `0x6B` or `6Bh`; None if the text is not a number.

    >>> parse_number("0x6B"), parse_number("6Bh"), parse_number("six")
    (107, 107, None)
    """
    match = _NUMBER.fullmatch(text.strip().casefold().replace("_", ""))
    if match is None:
        return None
    digits = match["hex"] or match["suffixed"]
    return int(match["decimal"]) if digits is None else int(digits, 16)


def parse_code(text: str) -> int | None:
    """Parse `3`, `0x03`, `fc3` or `function 3`; None if the text is not a function code."""
    match = _CODE.fullmatch(text.strip().casefold())
    return None if match is None else parse_number(match[1])


def normalized(text: str) -> str:
    """A name in lower case without spaces and punctuation: `read_coils` equals `Read Coils`.

    >>> normalized("Read/Write Multiple Registers")
    'readwritemultipleregisters'
    """
    return re.sub(r"[^a-z0-9]", "", text.casefold())


def similar_name(text: str, known: Iterable[str], *, least: float = 0.6) -> str | None:
    """The known name most similar to a misspelled one; None if none is `least` similar, of 1.

    >>> similar_name("quantitty", ["address", "quantity"])
    'quantity'
    """
    return _modlens.similar_name(text, list(known), least)


def find_function(word: int | str, *, source: _modlens.Functions | None = None) -> FunctionChoice:
    """Find a function by its code or name; `UsageError` suggests a similar name."""
    code = word if isinstance(word, int) else parse_code(word)
    if code is not None:
        if not 1 <= code <= HIGHEST_CODE:
            raise UsageError(f"function code {code} is not from 1 to {HIGHEST_CODE}")
        return FunctionChoice(code)
    named = function_names(source=source)
    by_plain = {normalized(name): choice for name, choice in named.items()}
    found = by_plain.get(normalized(str(word)))
    if found is not None:
        return found
    hint = similar_name(str(word), named)
    advice = "see `modlens explain list`" if hint is None else f"did you mean {hint!r}?"
    raise UsageError(f"no function {word!r}; {advice}")


def function_names(*, source: _modlens.Functions | None = None) -> dict[str, FunctionChoice]:
    """All names of functions and sub-functions.

    >>> function_names()["Read Device Identification"]
    FunctionChoice(code=43, preset={'mei_type': 14})
    """
    found: dict[str, FunctionChoice] = {}
    for entry in vocabulary.names("diagnostics"):
        found[entry.name] = FunctionChoice(DIAGNOSTICS, {"sub_function": entry.code})
    for row in functions(source):
        found[row.label] = FunctionChoice(row.code, dict([row.when] if row.when else []))
    for row in functions(source):
        found[row.name] = FunctionChoice(row.code)
    return found
