"""What `make check` chooses is there, and is chosen for every crate and folder."""

from __future__ import annotations

import pytest

from tests.support.changed import (
    CRATES_OF_TABLES,
    ROOT,
    TESTS_OF_CRATES,
    TESTS_OF_FILES,
    commands,
    python_tests,
)

SOURCES = [
    path.relative_to(ROOT).as_posix()
    for folder in ("modlens", "analyzer", "dissectors")
    for path in (ROOT / folder).rglob("*.py")
]


def test_each_crate_has_its_tests() -> None:
    """A further crate brings its line."""
    assert set(TESTS_OF_CRATES) == {path.name for path in (ROOT / "crates").iterdir()}
    named = [test for tests in TESTS_OF_CRATES.values() for test in tests]
    for test in [*named, *TESTS_OF_FILES, *TESTS_OF_FILES.values()]:
        assert (ROOT / test).exists(), test


@pytest.mark.parametrize("source", SOURCES)
def test_each_file_has_tests(source: str) -> None:
    """Besides its own doctests, and all are there."""
    chosen = python_tests([source])
    assert len(chosen) > 1
    assert all((ROOT / test.split("::")[0]).exists() for test in chosen)


def test_tests_are_those_of_the_name_or_the_folder() -> None:
    """The nearest ones."""
    assert python_tests(["analyzer/filters.py"]) == [
        "analyzer/filters.py",
        "tests/analyzer/test_filters.py",
        "tests/analyzer/test_filters_people_type.py",
    ]
    exports = python_tests(["analyzer/exports/sink.py"])
    assert exports == ["analyzer/exports/sink.py", "tests/analyzer/exports/test_sink.py"]
    folder = python_tests(["analyzer/exports/lines.py"])
    assert "tests/analyzer/exports/test_sink.py" in folder
    assert "tests/analyzer/test_filters.py" not in folder
    assert python_tests(["tests/docs/test_readme.py"]) == ["tests/docs/test_readme.py"]


def test_a_file_that_a_recipe_changes_is_tried_with_it() -> None:
    """The help of a command may be the place of a step of CONTRIBUTING.md."""
    place = "tests/docs/test_contributing.py::test_a_step_has_its_place"
    assert place in python_tests(["analyzer/cli/__init__.py"])
    assert place in python_tests(["crates/modlens-engine/src/findings/frame.rs"])
    assert place not in python_tests(["analyzer/filters.py"])


def test_a_change_in_rust_is_tested_in_both_languages() -> None:
    """The crate's own tests, and those in Python that show what it does."""
    words = [" ".join(command) for command in commands(["crates/modlens-writers/src/csv.rs"])]
    assert any(line.startswith("cargo test") and "modlens-writers" in line for line in words)
    assert "tests/analyzer/exports/test_sink.py" in words[-1]
    assert not any("mypy" in line for line in words)


def test_a_table_is_tested_by_the_crate_that_embeds_it() -> None:
    """Each table is there and is included by the crate that is named."""
    for table, crate in CRATES_OF_TABLES.items():
        sources = (ROOT / "crates" / crate / "src").rglob("*.rs")
        assert any(f'{table}")' in source.read_text() for source in sources), table
    words = [" ".join(command) for command in commands(["dissectors/diagnoses.toml"])]
    assert any(line.startswith("cargo test") and "modlens-diagnosis" in line for line in words)
    assert "tests/doctor" in words[-1]
    assert "tests/dissectors" not in words[-1]


def test_without_a_change_the_quick_linters_are_left() -> None:
    """Nothing is built."""
    assert [command[2] for command in commands([])] == ["ruff", "ruff"]
