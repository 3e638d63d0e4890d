"""No type has so many methods that nobody keeps all of them in mind."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

from tests.conftest import ROOT

CRATES = sorted(ROOT.glob("crates/*/src"))
MAX_METHODS = 60
LARGE = {"modlens-engine": {"Search": 118, "UnframedRegion": 74, "Pairing": 75, "TrafficModel": 67}}
"""Types that are still larger. The list may become shorter, and its numbers smaller."""
BLOCK = re.compile(
    r"^impl(?:<[^{]*?>)? (?:[^{]*? for )?(?P<name>\w+)[^{]*\{\n(?P<body>.*?)^\}", re.S | re.M
)
METHOD = re.compile(r"^    (?:pub(?:\([^)]*\))? )?(?:const )?(?:unsafe )?fn ", re.M)


def methods(source: Path) -> Counter[str]:
    """Counts the methods of each type of a crate, tests left out."""
    found: Counter[str] = Counter()
    for path in source.rglob("*.rs"):
        text = path.read_text(encoding="utf-8").split("#[cfg(test)]\nmod tests")[0]
        for block in BLOCK.finditer(text):
            found[block["name"]] += len(METHOD.findall(block["body"]))
    return found


@pytest.mark.parametrize("source", CRATES, ids=[source.parent.name for source in CRATES])
def test_no_type_has_too_many_methods(source: Path) -> None:
    """Split by what changes together; the files of an `impl` do not make a type smaller."""
    found = methods(source)
    large = {name: count for name, count in found.items() if count > MAX_METHODS}
    assert large == LARGE.get(source.parent.name, {})


def test_methods_in_several_files_are_counted() -> None:
    """Counts both types of the engine that have an `impl` in many files."""
    found = methods(ROOT / "crates" / "modlens-engine" / "src")
    assert found["Session"] > 30
    assert found["Decoder"] > 30
