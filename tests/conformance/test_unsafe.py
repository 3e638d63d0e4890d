"""Where `unsafe` is: the list of ARCHITECTURE.md is that of the sources."""

from __future__ import annotations

import re

from tests.conftest import ROOT

UNSAFE = re.compile(r"\bunsafe\s*[({]|\bunsafe (fn|impl|trait|extern)\b|allow\(unsafe_code\)")


def test_every_file_with_unsafe_is_listed() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    section = text.partition("## Where `unsafe` is")[2].partition("\n## ")[0]
    listed = re.findall(r"^\| `(\S+\.rs)` \|", section, re.MULTILINE)
    sources = [*ROOT.glob("crates/**/*.rs"), *ROOT.glob("fuzz/*/*.rs")]
    found = [path for path in sources if UNSAFE.search(path.read_text(encoding="utf-8"))]
    assert sorted(listed) == sorted(path.relative_to(ROOT).as_posix() for path in found)


def test_every_block_says_why() -> None:
    """A comment that begins with SAFETY is directly in front, as in the standard library."""
    for path in ROOT.glob("crates/**/*.rs"):
        lines = path.read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines):
            if re.search(r"\bunsafe\s*\{", line):
                assert "SAFETY:" in "".join(lines[max(number - 3, 0) : number]), (path, number + 1)
