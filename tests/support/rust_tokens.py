"""The names and punctuation marks of a Rust source, without comments, strings and tests."""

from __future__ import annotations

import re
from typing import NamedTuple

TOKEN = re.compile(
    r"""//[^\n]*|/\*.*?\*/                   # comments
    |b?r(?P<hashes>\#*)".*?"(?P=hashes)      # raw strings
    |b?"(?:\\.|[^"\\])*"                     # strings
    |b?'(?:\\[^']*'|\\''|[^\\']')|'\w+       # characters, and lifetimes
    |(?P<kept>(?:r\#)?[A-Za-z_]\w*|::|\d\w*|[^\s\w])""",
    re.VERBOSE | re.DOTALL,
)
CLOSING = {"{": "}", "(": ")", "[": "]"}


class Token(NamedTuple):
    """A name, number or punctuation mark, and the line it is in."""

    text: str
    line: int


def tokens(text: str) -> list[Token]:
    """The names and punctuation marks of a source; comments, strings and lifetimes are left out.

    >>> [token.text for token in tokens("let a = b::C; // d")]
    ['let', 'a', '=', 'b', '::', 'C', ';']
    """
    found = []
    line, at = 1, 0
    for match in TOKEN.finditer(text):
        line += text.count("\n", at, match.start())
        at = match.start()
        if kept := match["kept"]:
            found.append(Token(kept.removeprefix("r#"), line))
    return found


def without_tests(source: list[Token]) -> list[Token]:
    """The tokens without the items and fields that `#[cfg(test)]` or `#[test]` is before."""
    kept: list[Token] = []
    at = 0
    while at < len(source):
        if _starts_test(source, at):
            at = _end_of_item(source, at)
        else:
            kept.append(source[at])
            at += 1
    return kept


def _starts_test(source: list[Token], at: int) -> bool:
    words = tuple(token.text for token in source[at : at + 7])
    return words in (
        ("#", "[", "cfg", "(", "test", ")", "]"),
        ("#", "[", "cfg", "(", "all", "(", "test"),
    ) or words[:4] == ("#", "[", "test", "]")


def _end_of_item(source: list[Token], at: int) -> int:
    """The place after the item or field whose attributes begin here."""
    while source[at].text == "#":
        at = end_of_group(source, at + 1)
    is_use = _keyword(source, at) == "use"
    while at < len(source):
        text = source[at].text
        if text in CLOSING:
            at = end_of_group(source, at)
            if text == "{" and not is_use:
                return at
        elif text == "}":
            return at
        else:
            at += 1
            if text in (";", ","):
                return at
    return at


def _keyword(source: list[Token], at: int) -> str:
    """Returns the first word of an item after `pub` or `pub(in ..)`."""
    if source[at].text == "pub":
        at += 1
        if source[at].text == "(":
            at = end_of_group(source, at)
    return source[at].text


def end_of_group(source: list[Token], at: int) -> int:
    """The place after the bracket that closes the one here."""
    depth = 0
    while at < len(source):
        text = source[at].text
        depth += (text in CLOSING) - (text in CLOSING.values())
        at += 1
        if depth == 0:
            break
    return at
