"""Checks that the version is defined once and that workflows only call make and .ci/run."""

from __future__ import annotations

import json
import re
import subprocess
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import _modlens
from release import rust, sbom
from release.licences import OUTPUT, document
from release.targets import GATEWAYS, TARGETS
from tests.conftest import ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS_OF_MAKE = set(
    re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
)
PINNED = r"[\w./-]+@([0-9a-f]{40}|v\d+(\.\d+)*)"


def test_the_version_stands_once() -> None:
    """In Cargo.toml; the build takes the wheel's from there, the extension has it compiled in."""
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))
    version = cargo["workspace"]["package"]["version"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "version" not in project
    assert "version" in project["dynamic"]
    assert _modlens.__version__ == version
    assert metadata.version("modlens") == version
    for path in ROOT.glob("crates/*/Cargo.toml"):
        crate = tomllib.loads(path.read_text(encoding="utf-8"))["package"]
        assert crate["version"] == {"workspace": True}, path


@pytest.mark.parametrize(
    ("triple", "own"),
    [("armv7-unknown-linux-musleabihf", True), ("armv7-unknown-linux-gnueabihf", False)],
)
def test_start_files_of_musl_are_those_of_zig_where_rust_has_none(
    triple: str, own: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They come with Rust's standard library, which is compiled where it cannot be fetched."""
    monkeypatch.setattr(rust, "_have_standard_library", lambda _: False)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: None)
    name = f"CARGO_TARGET_{triple.replace('-', '_').upper()}_RUSTFLAGS"
    flags = rust.environment([triple]).get(name, "")
    assert ("link-self-contained=no" in flags) == own


def test_the_changelog_begins_with_this_version() -> None:
    """A release has its section."""
    first = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert first is not None
    assert first[1].rstrip(",") == _modlens.__version__


def test_the_licences_are_those_of_the_locked_crates() -> None:
    """Where a crate has come or gone: make licences."""
    assert OUTPUT.read_text(encoding="utf-8") == document()


def test_the_list_of_crates_is_that_of_the_locked_ones() -> None:
    """It is the same on every machine, and names none. Where a crate has come: make licences."""
    text = sbom.document()
    assert sbom.OUTPUT.read_text(encoding="utf-8") == text
    assert "file:" not in text
    assert str(ROOT) not in text
    content = json.loads(text)
    refs = {one["bom-ref"] for one in content["components"]}
    refs.add(content["metadata"]["component"]["bom-ref"])
    assert {one["ref"] for one in content["dependencies"]} == refs
    assert all(set(one["dependsOn"]) <= refs for one in content["dependencies"])


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_calls_make_and_pinned_actions(path: Path) -> None:
    """What it does can be done at home, and its actions have versions."""
    jobs = YAML(typ="safe").load(path.read_text(encoding="utf-8"))["jobs"]
    for job in jobs.values():
        for step in job["steps"]:
            assert re.fullmatch(PINNED, step.get("uses", "make@v1")), step
            for line in step.get("run", "").splitlines():
                words = line.split()
                allowed = words[0] in ("make", ".ci/run") or words[:2] == ["sudo", "apt-get"]
                assert allowed, line
                assert words[0] != "make" or words[1] in TARGETS_OF_MAKE, line


def test_pull_requests_are_checked_by_the_same_script() -> None:
    """The workflow has a quick and a full job; the container installs what .ci/run installs."""
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    workflow = YAML(typ="safe").load(text)
    assert {"push", "pull_request"} == set(workflow["on"])
    jobs = workflow["jobs"]
    runs = {
        name: [step["run"] for step in job["steps"] if "run" in step] for name, job in jobs.items()
    }
    assert runs["quick"] == [".ci/run quick"]
    assert runs["full"] == [".ci/run"]
    image = (ROOT / ".devcontainer" / "Dockerfile").read_text(encoding="utf-8")
    assert f"FROM {jobs['full']['container']}\n" in image
    assert "COPY .ci/install" in image
    assert ".ci/install\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("job", "key", "names"),
    [("wheels", "target", list(TARGETS)), ("gateways", "machine", list(GATEWAYS))],
)
def test_the_workflow_builds_every_target(job: str, key: str, names: list[str]) -> None:
    """Wheels and binaries of the matrices are those of release/targets.py."""
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    assert YAML(typ="safe").load(text)["jobs"][job]["strategy"]["matrix"][key] == names
