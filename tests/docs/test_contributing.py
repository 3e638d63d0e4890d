"""The recipes of CONTRIBUTING.md are true: what is quick to try is tried here.

The rest is tried by `make recipes`, see test_recipes.py.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from analyzer import decode
from tests.conftest import ROOT, TIMEOUT_S, environment
from tests.docs.documents import blocks, rows_of_table, shell, shell_environment, text_of
from tests.docs.recipes import DOCUMENT, METER, Step, carry_out, copy_of_the_tree, place, steps

STEPS = steps()


@pytest.mark.parametrize("step", STEPS, ids=lambda step: f"{step.how} {step.file}")
def test_a_step_has_its_place(step: Step) -> None:
    """The line it names is there, once; a new file is new."""
    path = ROOT / step.file
    if step.how == "new":
        assert not path.exists()
    else:
        place(step, path.read_text(encoding="utf-8"))


def test_each_recipe_has_its_steps() -> None:
    """The recipes' steps are found: a test that found none would never fail."""
    files = " ".join(step.file for step in STEPS)
    for word in ("meter.toml", "dialects.toml", "exports/wiki.py", "columns.toml", "finding.rs"):
        assert word in files


def test_a_row_for_a_device_works_at_once(tmp_path: Path) -> None:
    """The file of the first recipe, and every command shown with it."""
    (row,) = (step for step in STEPS if step.file == "meter.toml")
    env = shell_environment(tmp_path)
    (tmp_path / row.file).write_text(row.text)
    shown = "".join(block.text for block in blocks(DOCUMENT, "console"))
    runs = re.findall(r"^\$ (.*)\n((?:[^$].*\n)*)", shown, re.MULTILINE)
    assert len(runs) > 2
    for line, expected in runs:
        done = shell(line, cwd=tmp_path, env=env)
        assert (done.stdout or done.stderr) == expected, line


def test_an_export_is_found_by_its_tests(tmp_path: Path) -> None:
    """The recipe on a copy of the tree: the conformance tests walk to the new format."""
    tree = copy_of_the_tree(tmp_path / "copy")
    recipe = [step for step in steps("python") if "exports" in step.file]
    assert len(recipe) > 3
    for step in recipe:
        carry_out(step, tree)
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/conformance/test_exports.py"]
    words += ["-k", "wiki or reader"]
    done = subprocess.run(
        [sys.executable, *words],
        cwd=tree, env=environment(), capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    listed = subprocess.run(
        [sys.executable, "-m", "analyzer", "formats"],
        cwd=tree, env=environment(), capture_output=True, text=True, timeout=TIMEOUT_S, check=True,
    )  # fmt: skip
    assert ".wiki" in listed.stdout


def test_a_command_runs(tmp_path: Path) -> None:
    """Applies the recipe to a copy: the command has help and counts ordinary traffic."""
    tree = copy_of_the_tree(tmp_path / "copy")
    recipe = [step for step in steps("python") if "analyzer/cli" in step.file]
    assert len(recipe) == 2
    for step in recipe:
        carry_out(step, tree)
    recording = "captures/pymodbus_two_units/recording.jsonl"
    for words, expected in (
        (["--help"], "count the transactions of recordings"),
        (["count", "--help"], "recordings to read"),
        (["count", recording], f"{len(decode(ROOT / recording).transactions)} transactions"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "analyzer", *words],
            cwd=tree,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=True,
        )
        assert expected in done.stdout


def test_the_commands_are_targets() -> None:
    """Every `make` of the table is in the Makefile, and every target of it in the table."""
    said = {row[0].split()[1].strip("`") for row in rows_of_table(DOCUMENT, "| command |")}
    targets = set(re.findall(r"^([a-z-]+):", text_of("Makefile"), re.MULTILINE))
    assert targets - {"clean"} == said


def test_files_that_are_named_exist() -> None:
    """Every path of the documents, but for those that a recipe makes."""
    made = {step.file for step in STEPS if step.how == "new"} | {METER}
    for document in (DOCUMENT, "ARCHITECTURE.md", "README.md", "THIRD_PARTY.md"):
        for path in re.findall(r"`((?:[\w.]+/)+[\w.]*)`", text_of(document)):
            assert path in made or path in ("dist/", "site/") or (ROOT / path).exists(), (
                document,
                path,
            )
