"""Finds what people read in a file: comments, doc comments, strings, and the text of documents.

Names in the code, code between backquotes, fenced blocks and fields of f-strings are left out.
"""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Span", "spans"]


@dataclass(frozen=True, slots=True)
class Span:
    """Holds a part of a file that is prose, and where it begins; `is_string` if it is a literal."""

    start: int
    text: str
    is_string: bool = False


_RUST = re.compile(
    r"""(?P<comment>//[^\n]*)
    |b?r(?P<hashes>\#*)"(?P<raw>.*?)"(?P=hashes)
    |b?"(?P<string>(?:\\.|[^"\\])*)"
    |b?'(?:\\[^']*'|\\''|[^\\'\n]')""",
    re.VERBOSE | re.DOTALL,
)
_TOML = re.compile(
    r'(?P<comment>\#[^\n]*)|"""(?P<raw>.*?)"""|"(?P<string>(?:\\.|[^"\\\n])*)"|\'[^\'\n]*\'',
    re.DOTALL,
)
_HASH_COMMENT = re.compile(r"#[^\n]*")
_FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
_CODE = re.compile(r"`[^`\n]*`|\]\([^)\s]*\)")
_FIELD = re.compile(r"\{[^{}\n]*\}")


def spans(path: Path) -> list[Span]:
    """Returns the prose of a file in order."""
    text = path.read_text(encoding="utf-8")
    if path.suffix in (".py", ".pyi"):
        found = _python(text)
    elif path.suffix == ".rs":
        found = _matches(_RUST, text)
    elif path.suffix == ".toml":
        found = _matches(_TOML, text)
    elif path.suffix == ".md":
        found = _outside(_FENCED, Span(0, text))
    else:
        found = (Span(one.start(), one[0]) for one in _HASH_COMMENT.finditer(text))
    return [part for span in found for part in _outside(_CODE, span)]


def _matches(pattern: re.Pattern[str], text: str) -> Iterator[Span]:
    for match in pattern.finditer(text):
        for group in ("comment", "raw", "string"):
            if match[group]:
                yield from _outside(
                    _FIELD, Span(match.start(group), match[group], group != "comment")
                )


def _python(text: str) -> Iterator[Span]:
    lines = [0]
    for line in text.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
    logical_start = True
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        start = lines[token.start[0] - 1] + token.start[1]
        if token.type == tokenize.COMMENT:
            yield Span(start, token.string)
        elif token.type == tokenize.STRING:
            is_docstring = logical_start and '"""' in token.string
            span = Span(start, token.string, not is_docstring)
            yield from _outside(_FIELD, span) if span.is_string else [span]
        if token.type not in (tokenize.COMMENT, tokenize.NL):
            logical_start = token.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)


def _outside(pattern: re.Pattern[str], span: Span) -> Iterator[Span]:
    """Yields what is between the matches of a pattern."""
    at = 0
    for match in pattern.finditer(span.text):
        yield Span(span.start + at, span.text[at : match.start()], span.is_string)
        at = match.end()
    yield Span(span.start + at, span.text[at:], span.is_string)
