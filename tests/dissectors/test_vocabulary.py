"""Names and texts: all there, in the style of the house."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissectors import vocabulary
from dissectors.vocabulary import Kind, Name, names

EXPECTED: dict[Kind, set[int]] = {
    "exceptions": {1, 2, 3, 4, 5, 6, 8, 10, 11},
    "diagnostics": {0, 1, 2, 3, 4, *range(10, 19), 20},
    "mei_types": {13, 14},
    "read_device_id_codes": {1, 2, 3, 4},
    "conformity_levels": {0x01, 0x02, 0x03, 0x81, 0x82, 0x83},
}

ENTRIES = [entry for kind in (*EXPECTED, "object_ids") for entry in names(kind)]


@pytest.mark.parametrize("kind", list(EXPECTED))
def test_every_number_of_the_specification_has_its_entry(kind: Kind) -> None:
    """No more and no less than the specification names."""
    assert {entry.code for entry in names(kind)} == EXPECTED[kind]


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_every_entry_has_its_texts(entry: Name) -> None:
    """Name, section and meaning; meanings are phrases, so they have no full stop."""
    assert entry.name
    assert entry.section[:1] in "67"
    assert entry.meaning
    assert not entry.meaning.endswith(".")
    assert entry.code <= entry.last


def test_exceptions_say_what_to_check() -> None:
    """Every exception has advice in sentences."""
    assert all(entry.check.endswith(".") for entry in names("exceptions"))


def test_object_ids_cover_a_byte() -> None:
    """Every object id of a byte has exactly one entry."""
    covered = [code for entry in names("object_ids") for code in range(entry.code, entry.last + 1)]
    assert covered == list(range(256))


def test_look_ups() -> None:
    """Known numbers give entries, unknown ones None."""
    assert vocabulary.exception_name(11) == "Gateway Target Device Failed to Respond"
    assert vocabulary.exception_name(99) == "Exception 99"
    assert vocabulary.exception(7) is None
    assert vocabulary.diagnostic(19) is None


def test_findings_are_documented() -> None:
    """Every finding of the core has a title, a reason and advice."""
    assert vocabulary.findings()
    for finding in vocabulary.findings():
        assert vocabulary.finding(finding.code) == finding
        assert finding.severity in {"info", "warning", "error"}
        assert finding.title
        assert finding.why
        assert finding.advice
    assert vocabulary.finding("no_such_code") is None


def test_vendors_are_listed() -> None:
    """The names that `--functions` takes: every file of the folder."""
    folder = Path(__file__).parents[2] / "dissectors" / "vendor"
    assert set(vocabulary.vendors()) == {path.stem for path in folder.glob("*.toml")}
