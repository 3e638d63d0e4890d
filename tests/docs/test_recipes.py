"""All recipes of CONTRIBUTING.md together: a copy of the tree, changed, built and tested.

Takes minutes, so it runs by `make recipes` and under CI only.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.conftest import ROOT, environment
from tests.docs.recipes import METER, Step, carry_out, copy_of_the_tree, steps

TIMEOUT_S = 900
TARGET = ROOT / "target" / "recipes"

pytestmark = pytest.mark.skipif(
    "1" not in (os.environ.get("MODLENS_CI"), os.environ.get("MODLENS_RECIPES")),
    reason="takes minutes: make recipes",
)


def run(words: Sequence[str], tree: Path) -> str:
    """What a command said in the copy; its failure is the test's."""
    env = environment(CARGO_TARGET_DIR=str(TARGET))
    done = subprocess.run(
        list(words),
        cwd=tree, env=env, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The copy after all recipes.

    It is built in a copy of the checkout's build folder, which has the dependencies already. In
    the folder itself cargo would take what the recipes added for the checkout's own: it reports the
    crates of a workspace apart by their paths inside it.
    """
    tree = copy_of_the_tree(tmp_path_factory.mktemp("recipes") / "copy")
    for step in steps():
        carry_out(Step(METER, "new", "", step.text) if step.file == "meter.toml" else step, tree)
    shutil.rmtree(TARGET, ignore_errors=True)
    shutil.copytree(ROOT / "target" / "release", TARGET / "release")
    yield tree
    shutil.rmtree(TARGET)


@pytest.fixture(scope="module")
def built(tree: Path) -> Path:
    """The copy with the extension in it; there it hides the installed one."""
    folder = tree.with_name("wheel")
    words = ["pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(tree)]
    run([sys.executable, "-m", *words], tree)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tree, [name for name in archive.namelist() if name.startswith("_mod")])
    run([sys.executable, "-m", "tests.support.row_types"], tree)
    return tree


def test_the_core_knows_them(tree: Path) -> None:
    """The core's own tests: samples of formats, texts of findings, the columns of the file."""
    words = ["cargo", "test", "--release", "--locked", "--workspace"]
    words += ["--exclude", "modlens-py", "--exclude", "modlens-bench", "--lib"]
    out = run(words, tree)
    for name in (
        "every_notation_reads_the_same_bytes",
        "every_finding_has_its_text",
        "columns_of_the_file_and_of_the_code_agree",
    ):
        assert name in out


@pytest.mark.parametrize("folder", ["conformance", "border", "dissectors"])
def test_the_tests_that_walk_the_registries_find_them(folder: str, built: Path) -> None:
    """Tests that find a new function, format, export, column or finding by themselves."""
    words = ["pytest", "-q", "-p", "no:cacheprovider", f"tests/{folder}"]
    # The README gets its rows by hand, and the stub was not changed.
    run([sys.executable, "-m", *words, "-k", "not readme and not stub"], built)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["explain", "--functions", "meter", "100"], "Read Meter Serial"),
        (["formats"], "our gateway's trace"),
        (["explain", "address_end"], "beyond address 65535"),
        (["explain", "single_registers"], "register by register"),
        (["show", "01 03 FF FF 00 02 C4 2F"], "address_end"),
    ],
)
def test_a_user_sees_them(words: list[str], expected: str, built: Path) -> None:
    """The commands that list things show what the recipes have added."""
    assert expected in run([sys.executable, "-m", "analyzer", *words], built)


@pytest.mark.parametrize("name", ["address_end", "every_column"])
def test_they_show_in_ordinary_traffic(name: str, built: Path) -> None:
    """Between plain exchanges, which take the fast path, and not on a single frame alone."""
    words = ["pytest", "-q", "-p", "no:cacheprovider", "tests/conformance/test_ordinary_traffic.py"]
    assert " passed" in run([sys.executable, "-m", *words, "-k", name], built)


def test_a_diagnosis_is_named_in_ordinary_traffic(tree: Path) -> None:
    """Its own test, and those that compare counting in bulk, one by one, and in parts."""
    words = ["cargo", "test", "--release", "--locked", "-p", "modlens-diagnosis"]
    out = run([*words, "--lib", "--test", "single_registers", "--test", "merging"], tree)
    for name in ("it_is_named_in_ordinary_traffic", "parts_merge_to_the_whole", "one_by_one"):
        assert name in out


def test_a_plot_is_in_the_report(built: Path) -> None:
    """It is drawn from ordinary traffic, with the sum of its series in the legend."""
    words = ["pytest", "-q", "-p", "no:cacheprovider", "tests/analyzer/report/test_browser.py"]
    assert "1 passed" in run([sys.executable, "-m", *words, "-k", "each_plot and heard"], built)


def test_a_column_is_in_every_export(built: Path) -> None:
    """The new column is in every export, and can be used in filters."""
    words = ["decode", "captures/seed_rtu/recording.hex", "--table", "frames", "--to", "wiki"]
    words += ["--columns", "byte_offset,byte_length,byte_end", "--where", "byte_end == 8"]
    out = run([sys.executable, "-m", "analyzer", *words], built)
    assert out.splitlines() == [
        "|| byte_offset || byte_length || byte_end ||",
        "| 0 | 8 | 8 |",
    ]
