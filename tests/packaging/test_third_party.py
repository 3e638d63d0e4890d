"""THIRD_PARTY.md names every crate in the extension, and every package that is installed beside."""

from __future__ import annotations

import re
import subprocess
import tomllib

from tests.conftest import ROOT
from tests.docs.documents import rows_of_table

DOCUMENT = "THIRD_PARTY.md"
TREE = ("cargo", "tree", "--locked", "--package", "modlens-py", "--edges", "normal,no-proc-macro")


def test_every_crate_is_named_with_its_licence() -> None:
    """Every crate that Cargo lists for any system is named with its licence."""
    words = [*TREE, "--prefix", "none", "--format", "{p}|{l}"]
    tree = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True, timeout=120)
    pairs = {
        (line.split(" ")[0], line.partition("|")[2].removesuffix(" (*)"))
        for line in tree.stdout.splitlines()
        if not line.startswith("modlens")
    }
    said = {(crate, licence) for crate, licence in rows_of_table(DOCUMENT, "| crate |")}
    assert pairs == said


def test_every_package_is_named() -> None:
    """Every dependency of pyproject.toml is named."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {re.split(r"[<>=]", text)[0] for text in project["dependencies"]}
    assert {row[0] for row in rows_of_table(DOCUMENT, "| package |")} == names
