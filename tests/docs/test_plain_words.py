"""Refuses words of a private dialect in what people read: strings, comments and documents.

The usual words are on the right side of `INSTEAD`. Names in code are not looked at, except those
of types.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.prose import spans

_DEVICES = (
    "gateway|gateways|server|servers|proxy|converter|firewall|router|broker|hub|device|adapter"
)
INSTEAD = {
    r"(?<!nothing )(?<!left )(?<!one step )behind"
    rf"(?! (?:(?:a|an|the|its|one|each|some) )?(?:\w+ )?(?:{_DEVICES})\b)": "after, following",
    r"(?:is|are|was|were|be|been) told|tells|says of": "is reported, reports, shows, distinguishes",
    r"without a doubt|no doubt about": "unambiguous",
    r"in the room of|comes? to lie": "in the slot of, is stored",
    r"a second time|once more|anew": "again",
    r"by accident|accident bring": "by chance",
    r"(?<!of )courses?(?! of\b) over time|courses": "time series",
    r"(?:give|gives|given|giving) out": "emit, return",
    r"pieces?": "block, segment, slice, part",
    r"mend|mends|mended|mending": "fix",
    r"stands? (?:in|once)": "is in, is defined once",
    r"(?<!\")reserves?|headroom": "margin",
    r"time-outs?": "timeout",
    r"commonest": "most common",
    r"(?:leave|leaves|left) away": "leave out",
    r"look what": "see which",
    r"works with trouble": "works, but has problems",
    r"something else than": "something other than",
    r", too\.": "also",
    r"lamps?": "LED",
    r"(?:file|files|recording|recordings|member|members) (?:is|are|was|were) not taken": "skipped",
}
"""What is refused -> what to write."""

REFUSED = re.compile(
    r"(?<![\w.-])(?:" + "|".join(f"(?:{one})" for one in INSTEAD) + r")(?!\w)", re.IGNORECASE
)
TYPE_NAMES = re.compile(r"\b(?:struct|enum|trait|class) (?:Known|Held|Kept|Lent)[A-Z]\w*")
"""Write *Cache, *Memo, Pending*, Owned* or Borrowed*."""

SUFFIXES = {".py", ".pyi", ".rs", ".toml", ".md", ".yml"}
NOT_OURS = (
    "captures/",
    "dissectors/profiles/",
    "THIRD_PARTY",
    "requirements/",
    "tests/docs/test_plain_words.py",
)
"""Other people's words, and the list itself."""


def files(*folders: str) -> list[Path]:
    """Lists the files that git knows, with prose that is ours."""
    done = subprocess.run(
        ["git", "ls-files", "--", *folders], cwd=ROOT, capture_output=True, text=True, check=True
    )
    names = [one for one in done.stdout.splitlines() if not one.startswith(NOT_OURS)]
    return [
        ROOT / name
        for name in names
        if Path(name).suffix in SUFFIXES or Path(name).name in ("Makefile", "run", "install")
    ]


def _is_text(path: Path, text: str) -> bool:
    """Says whether a string is more than a key, and not one that a test compares."""
    return " " in text.strip() and path.relative_to(ROOT).parts[0] != "tests"


def refused(path: Path) -> list[str]:
    """Lists the places of a file with a word that is refused."""
    text = path.read_text(encoding="utf-8")
    found = [
        (span.start + match.start(), match[0])
        for span in spans(path)
        if not span.is_string or _is_text(path, span.text)
        for match in REFUSED.finditer(span.text)
    ]
    found += [(match.start(), match[0]) for match in TYPE_NAMES.finditer(text)]
    name = path.relative_to(ROOT)
    return [f"{name}:{text.count(chr(10), 0, at) + 1}: {word}" for at, word in found]


def test_a_refused_word_is_found() -> None:
    """The check works, and leaves other uses of a word alone."""
    assert REFUSED.search("What stands in the tree")
    assert REFUSED.search("the byte behind the frame")
    assert not REFUSED.search("units behind a gateway; connections behind one server")
    assert not REFUSED.search("of course, reserved, as it stands")


OTHER_ROOMS = (
    "analyzer/sources/dialects.toml",
    "crates/modlens-profiles/src/points/block_plan.rs",
    "crates/modlens-readers/src/pcap/",
    "crates/modlens-readers/tests/dialects.rs",
)
"""Still to be cleaned."""


@pytest.mark.parametrize("folder", sorted({path.relative_to(ROOT).parts[0] for path in files()}))
def test_no_refused_word(folder: str) -> None:
    """Comments, strings and documents use the usual words."""
    covered = [
        path for path in files(folder) if not str(path.relative_to(ROOT)).startswith(OTHER_ROOMS)
    ]
    assert [place for path in covered for place in refused(path)] == []
