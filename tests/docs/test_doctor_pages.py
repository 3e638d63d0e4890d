"""The pages on single causes: what they show is what the program prints.

A block in front of which "`NAME`, new:" stands is a file; `$` begins a command, and what follows is
its output. `MODLENS_UPDATE=1` writes the outputs again.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from dissectors import vocabulary
from dissectors.explain import explain
from tests.conftest import ROOT
from tests.docs.documents import blocks, shell, shell_environment, text_of

PAGES = sorted((ROOT / "docs" / "doctor").glob("*.md"))
CAUSES = [page for page in PAGES if page.stem != "index"]
COMMONEST = """
    slow_answers lockstep no_bias polled_too_fast swapped_wires address_off_by_one word_order
    connection_limit two_masters line_noise
""".split()
_FILE = re.compile(r"`([\w.]+)`, new:")
_RUN = re.compile(r"\$ (?P<line>.+)\n(?P<output>(?:(?!\$ ).*\n)*)")


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def test_the_ten_commonest_have_a_page() -> None:
    assert {page.stem for page in CAUSES} >= set(COMMONEST)
    assert {page.stem for page in CAUSES} <= {one.code for one in vocabulary.diagnoses()}


@pytest.mark.parametrize("page", CAUSES, ids=[page.stem for page in CAUSES])
def test_a_page_shows_what_the_program_prints(page: Path, tmp_path: Path) -> None:
    """In an empty folder that has the recordings, and the files of the page."""
    env, text = shell_environment(tmp_path), text_of(name(page))
    for language in ("text", "toml"):
        for block in blocks(name(page), language):
            match = _FILE.search(block.before)
            assert match, block.before
            (tmp_path / match[1]).write_text(block.text, encoding="utf-8")
    runs = [run for block in blocks(name(page), "console") for run in _RUN.finditer(block.text)]
    assert any(run["line"].startswith("modlens doctor ") for run in runs)
    for run in runs:
        done = shell(run["line"], cwd=tmp_path, env=env)
        assert done.returncode == 0, done.stderr
        if os.environ.get("MODLENS_UPDATE") == "1":
            text = text.replace(run[0], f"$ {run['line']}\n{done.stdout}")
            page.write_text(text, encoding="utf-8")
        else:
            assert done.stdout == run["output"]
    assert f"1. {page.stem} (" in text


@pytest.mark.parametrize("page", CAUSES, ids=[page.stem for page in CAUSES])
def test_a_page_tells_cause_and_cure_and_is_linked(page: Path) -> None:
    """From `modlens explain`, and from the list of causes."""
    headings = re.findall(r"^## (.+)$", text_of(name(page)), re.MULTILINE)
    assert headings == ["The cause", "The cure", "Not to be confused with"]
    assert f"docs/doctor/{page.name}" in str(explain(page.stem))
    assert f"({page.name})" in text_of("docs/doctor/index.md")
    assert "docs/doctor/" in text_of("README.md")
