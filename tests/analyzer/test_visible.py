"""Which characters no person gets to see: Python, the core and the pages have the same list."""

from __future__ import annotations

import re
import sys

from analyzer.visible import visible
from tests.conftest import ROOT

SURROGATES = {*range(0xD800, 0xE000)}
"""Halves of characters: texts of the core cannot hold them."""

CHARACTER = r"\\(?:0|(?:x|u\{?)([0-9a-f]+)\}?)"


def codes_of(source: str, between: str) -> set[int]:
    """The code points of a list of characters and ranges in the source of a program."""
    found: set[int] = set()
    for first, last in re.findall(f"{CHARACTER}(?:{between}{CHARACTER})?", source):
        begin = int(first or "0", 16)
        found |= {*range(begin, (int(last, 16) if last else begin) + 1)}
    return found


def test_the_same_characters_are_escaped_everywhere() -> None:
    of_python = {code for code in range(sys.maxunicode + 1) if visible(chr(code)) != chr(code)}
    assert {0, 0x1B, 0x9B, 0xAD, 0x202E, 0xFEFF, 0xE0041} | SURROGATES <= of_python
    assert not {*map(ord, "a °é温\u2003")} & of_python

    core = ROOT.joinpath("crates/modlens-protocol/src/visible.rs").read_text("utf-8")
    body = core.partition("fn is_unsafe")[2].partition("\n}")[0]
    assert codes_of(body, "'..='") == of_python - SURROGATES

    page = ROOT.joinpath("analyzer/report/assets/show.js").read_text("utf-8")
    (pattern,) = re.findall(r"const ESCAPED = /(.*)/gu;", page)
    assert codes_of(pattern, "-") == of_python
