"""The site is true: its commands run, its examples hold, its pictures are what the program shows.

Whether its pages hold together (menu, anchors, the notebook) is what `make docs` reports, where
each warning is an error.
"""

from __future__ import annotations

import importlib
import os
import re
import shlex
from pathlib import Path

import pytest

from analyzer.cli import COMMANDS, module_of
from analyzer.cli.parser import Parser
from analyzer.columns import TABLES, columns
from dissectors import vocabulary
from docs.make.reference import PAGES
from docs.make.screens import LIVE, PRINTED, drawn, picture, screen_of, words_in
from tests.conftest import ROOT
from tests.docs.documents import blocks, shell, shell_environment, text_of, try_examples

DOCS = ROOT / "docs"
NOTEBOOK = "docs/notebook.md"
WRITTEN = sorted(str(path.relative_to(ROOT)) for path in DOCS.rglob("*.md"))
RUN = [name for name in WRITTEN if blocks(name, "sh")]
IN_PYTHON = [name for name in WRITTEN if blocks(name, "python") and name != NOTEBOOK]
OTHERS = {
    "tcpdump": f"cat {ROOT}/captures/pymodbus_tcp/recording.pcap",
    "ssh": "shift; exec $*",
    "wireshark": "cat > wireshark.pcapng",
}
"""Programs that the site names beside modlens -> what stands for them here."""

PLAIN = ("mkdir", "printf")
"""Programs that every computer has, and that print nothing on the screen."""


def lines_of(document: str) -> list[str]:
    """The command lines of a page."""
    return [line for block in blocks(document, "sh") for line in block.text.splitlines()]


@pytest.mark.parametrize("document", RUN)
def test_the_commands_of_a_page_run(document: str, tmp_path: Path) -> None:
    """In the order of the page, in one folder that has the recordings; taps are tried below."""
    env = shell_environment(tmp_path)
    for name, does in OTHERS.items():
        program = tmp_path / "bin" / name
        program.write_text(f"#!/bin/sh\n{does}\n")
        program.chmod(0o755)
    for line in lines_of(document):
        assert line.split()[0] in ("modlens", *OTHERS, *PLAIN), line
        if not line.startswith("modlens tap"):
            done = shell(line, cwd=tmp_path, env=env)
            assert done.returncode == 0, (line, done.stderr)
            assert "skipped" not in done.stderr, line
            outputs = re.findall(r"-o (?:\w+:)?(\S+)|>>? ([\w.]+)$", line)
            assert all((tmp_path / (one or two)).stat().st_size for one, two in outputs), line
            assert done.stdout or outputs or line.startswith(PLAIN), line


@pytest.mark.parametrize(
    "line", [line for name in RUN for line in lines_of(name) if line.startswith("modlens tap")]
)
def test_a_tap_of_the_site_is_understood(line: str) -> None:
    """Its options exist and have such values; the README's tap is run as it is."""
    parser = Parser(prog="modlens tap", description="")
    importlib.import_module(module_of("tap")).add_arguments(parser)
    words = shlex.split(line.partition("|")[0])[2:]
    parser.parse_intermixed_args(words)


@pytest.mark.parametrize("document", IN_PYTHON)
def test_the_examples_in_python_hold(document: str) -> None:
    """All blocks of a page in turn, at the root of the checkout."""
    tried, failed = try_examples(document)
    assert tried
    assert failed == 0


@pytest.mark.parametrize("name", [*PRINTED, *LIVE])
def test_a_picture_is_what_the_program_shows(name: str) -> None:
    """Its words; `python -m docs.make.screens NAME` draws it again, for a person to look at."""
    assert words_in(picture(name).read_text("utf-8")) == words_in(drawn(screen_of(name)))


def test_each_picture_is_shown_and_there() -> None:
    """Those of the folder are those that the pages name, but for what belongs to every page."""
    shown = {
        Path(name).name
        for document in WRITTEN
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text_of(document))
    }
    kept = {path for kind in ("svg", "png") for path in (DOCS / "pictures").glob(f"*.{kind}")}
    assert shown == {path.name for path in kept}
    assert {f"{name}.svg" for name in (*PRINTED, *LIVE)} <= {*shown}


@pytest.mark.parametrize("document", WRITTEN)
def test_links_lead_to_pages_that_are_written_or_made(document: str) -> None:
    """Relative links; anchors are checked where the site is built."""
    made = {DOCS / "reference" / f"{name}.md" for name in PAGES} | {DOCS / "day.ipynb"}
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", text_of(document)):
        place = Path(os.path.normpath((ROOT / document).parent / target))
        assert place in made or place.exists(), target


def test_nothing_is_loaded_from_elsewhere() -> None:
    """No font, script or picture of another host in what is written by hand or drawn."""
    texts = [path for path in (DOCS / "pictures").iterdir() if path.suffix != ".png"]
    for path in texts:
        found = re.findall(r"https?://[^\"' )]+", path.read_text("utf-8"))
        assert set(found) <= {"http://www.w3.org/2000/svg"}, path


def test_the_reference_has_every_row_of_the_tables() -> None:
    """Commands, columns, findings, diagnoses."""
    pages = {name: make() for name, (_, make) in PAGES.items()}
    assert all(f"\n## {name}\n" in pages["commands"] for name in COMMANDS)
    for table in TABLES:
        section = pages["columns"].partition(f"\n## {table}\n")[2].partition("\n## ")[0]
        named = re.findall(r"^\| `(\w+)`", section, re.MULTILINE)
        assert named == [column.key for column in columns(table)]
    for code in (one.code for one in vocabulary.findings()):
        assert f"\n## {code}\n" in pages["findings"]
    for code in (one.code for one in vocabulary.diagnoses()):
        assert f"\n## {code}\n" in pages["diagnoses"]
