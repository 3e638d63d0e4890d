"""What modlens is made of: deny.toml without cargo-deny, and the pinned packages of the tests."""

from __future__ import annotations

import json
import re
import subprocess
import tomllib
from collections import defaultdict
from typing import Any

import pytest

from tests.conftest import ROOT

DENY = tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module", name="crates")
def _crates() -> list[dict[str, Any]]:
    """Every crate of Cargo.lock that is not ours."""
    words = ["cargo", "metadata", "--format-version", "1", "--locked"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    return [crate for crate in json.loads(done.stdout)["packages"] if crate["source"]]


def is_allowed(expression: str) -> bool:
    """Whether an SPDX expression can be met by what deny.toml allows."""
    words = re.findall(r"[()]|[^\s()]+(?: WITH \S+)?", expression.replace("/", " OR "))
    allowed = set(DENY["licenses"]["allow"])
    terms = [
        word.lower() if word in ("AND", "OR") else word if word in "()" else str(word in allowed)
        for word in words
    ]
    return bool(eval(" ".join(terms), {"__builtins__": {}}))


def test_expressions_are_understood() -> None:
    assert is_allowed("MIT OR GPL-3.0")
    assert is_allowed("(MIT OR Apache-2.0) AND Unicode-3.0")
    assert is_allowed("Apache-2.0 WITH LLVM-exception")
    assert not is_allowed("GPL-3.0")
    assert not is_allowed("MIT AND GPL-3.0")


def test_every_licence_is_allowed(crates: list[dict[str, Any]]) -> None:
    refused = {crate["name"]: crate["license"] for crate in crates if not crate["license"]}
    refused |= {
        crate["name"]: crate["license"] for crate in crates if not is_allowed(crate["license"])
    }
    assert refused == {}


def test_every_crate_is_there_once(crates: list[dict[str, Any]]) -> None:
    """But for those that deny.toml names, and none of them in vain."""
    versions: dict[str, set[str]] = defaultdict(set)
    for crate in crates:
        versions[crate["name"]].add(crate["version"])
    skipped: dict[str, set[str]] = defaultdict(set)
    for one in DENY["bans"]["skip"]:
        name, _, prefix = one["crate"].partition("@")
        found = {version for version in versions[name] if version.startswith(f"{prefix}.")}
        assert found, f"{one['crate']} is not there any more"
        skipped[name] |= found
    twice = {
        name: known - skipped[name]
        for name, known in versions.items()
        if len(known - skipped[name]) > 1
    }
    assert twice == {}


def test_every_crate_comes_from_the_registry(crates: list[dict[str, Any]]) -> None:
    allowed = {f"registry+{url}" for url in DENY["sources"]["allow-registry"]}
    assert {crate["source"] for crate in crates} == allowed


def test_no_crate_of_ours_can_be_published() -> None:
    """cargo-deny lets crates name each other by path only if none of them is for the registry."""
    manifests = [*ROOT.glob("crates/*/Cargo.toml"), ROOT / "fuzz" / "Cargo.toml"]
    told = {path: tomllib.loads(path.read_text("utf-8"))["package"] for path in manifests}
    published = [str(path) for path, one in told.items() if one.get("publish") is not False]
    assert published == []


def test_packages_of_the_tests_are_pinned_with_hashes() -> None:
    """Every package that pyproject.toml asks for, in one version that its range holds."""
    lines = (ROOT / "requirements" / "test.txt").read_text(encoding="utf-8").splitlines()
    pinned = [line for line in lines if line and line[0] not in " #"]
    assert all(re.match(r"[a-z0-9.-]+==[\w.!]+ ", line) for line in pinned)
    assert all(line.strip().startswith("--hash=sha256:") for line in lines if line[:1] == " ")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    names = {re.split(r"[<>=\[;]", text)[0].strip().lower().replace(".", "-") for text in wanted}
    assert names <= {line.partition("==")[0].replace(".", "-") for line in pinned}
