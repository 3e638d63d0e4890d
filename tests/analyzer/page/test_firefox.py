"""The page in Firefox: the rows of the command there, too."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import CAPTURES, Modlens
from tests.support.firefox import Firefox, running
from tests.support.page import (
    RECORDINGS,
    SAVED,
    SPELLINGS,
    STATE,
    TABLES,
    TROUBLE,
    TYPED,
    of_command,
)


@pytest.fixture(scope="module")
def firefox(tmp_path_factory: pytest.TempPathFactory, written: Path) -> Iterator[Firefox]:
    with running(tmp_path_factory.mktemp("firefox")) as found:
        found.open(written, "ready")
        yield found


def test_the_rows_are_those_of_the_command(firefox: Firefox, tmp_path: Path) -> None:
    """All recordings, all tables, cell by cell."""
    for path in RECORDINGS:
        firefox.run(f"{STATE} = 'waiting'")
        firefox.send_file("#file", path)
        firefox.wait(f"['shown', 'refused'].includes({STATE})")
        assert firefox.run(f"return {STATE}") == "shown", firefox.run(TROUBLE)
        for table, text in of_command(path, TABLES, tmp_path).items():
            assert firefox.ask(SAVED, table) == text, (path, table)


def test_the_map_is_that_of_the_command(firefox: Firefox, modlens: Modlens) -> None:
    """Every register with its last value."""
    path = CAPTURES / "pymodbus_types" / "recording.jsonl"
    firefox.run(f"{STATE} = 'waiting'")
    firefox.send_file("#file", path)
    firefox.wait(f"{STATE} === 'shown'")
    lines = modlens("map", path, "--json").out.splitlines()
    assert firefox.ask("Page.ask({ call: 'map' })") == [
        json.loads(line) | {"bus": path.name} for line in lines
    ]


def test_yaml_gives_the_rows_of_toml(firefox: Firefox, written: Path, tmp_path: Path) -> None:
    """Of a recording with a profile."""
    found = {}
    for form, text in SPELLINGS.items():
        profile = tmp_path / f"typed.{form}"
        profile.write_text(text, "utf-8")
        firefox.open(written, "ready")
        for path in (TYPED, profile):
            firefox.run(f"{STATE} = 'waiting'")
            firefox.send_file("#file", path)
            firefox.wait(f"{STATE} === 'shown'")
        found[form] = [firefox.ask(SAVED, table) for table in ("readings", "transactions")]
    assert found["yaml"] == found["toml"]
    assert ",level," in found["yaml"][0]


def test_no_connection_is_possible(firefox: Firefox) -> None:
    """Its policy holds in this browser as well."""
    found = firefox.ask("fetch('http://127.0.0.1:9/')")
    assert str(found).startswith("error: ")
    assert firefox.ask(
        "new Promise((done) => { addEventListener('securitypolicyviolation',"
        " ({ violatedDirective }) => done(violatedDirective), { once: true });"
        " fetch('http://127.0.0.1:9/').catch(() => 0); })"
    ) in ("connect-src", "default-src")
