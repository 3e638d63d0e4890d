"""Words explained."""

from __future__ import annotations

import pytest

import _modlens
from dissectors import vocabulary
from dissectors.errors import UsageError
from dissectors.explain import explain, known_words
from dissectors.table import functions

SPECIFICATION = "Modbus Application Protocol V1.1b3, section "


@pytest.mark.parametrize(
    ("word", "title", "section"),
    [
        ("3", "Read Holding Registers (function 3, 0x03)", "6.3"),
        ("0x03", "Read Holding Registers (function 3, 0x03)", "6.3"),
        ("FC3", "Read Holding Registers (function 3, 0x03)", "6.3"),
        ("0x83", "Read Holding Registers (function 3, 0x03)", "6.3"),
        ("read holding registers", "Read Holding Registers (function 3, 0x03)", "6.3"),
        ("exception 2", "Illegal Data Address (exception 2)", "7"),
        ("ex2", "Illegal Data Address (exception 2)", "7"),
        ("exception code 0x0B", "Gateway Target Device Failed to Respond (exception 11)", "7"),
        ("0x83 2", "Illegal Data Address (exception 2)", "7"),
        ("83 02", "Illegal Data Address (exception 2)", "7"),
        ("Illegal Data Address", "Illegal Data Address (exception 2)", "7"),
        ("exception 99", "Exception 99", "7"),
        ("8/11", "Return Bus Message Count (function 8, sub-function 11)", "6.8.1"),
        ("fc8 11", "Return Bus Message Count (function 8, sub-function 11)", "6.8.1"),
        ("diagnostics 4", "Force Listen Only Mode (function 8, sub-function 4)", "6.8.1"),
        ("Return Query Data", "Return Query Data (function 8, sub-function 0)", "6.8.1"),
        ("Diagnostics", "Diagnostics (function 8, 0x08)", "6.8"),
        ("43/14", "Read Device Identification (function 43, MEI type 14)", "6.21"),
        ("43.13", "CANopen General Reference (function 43, MEI type 13)", "6.20"),
        ("VendorName", "VendorName (object 0x00 of Read Device Identification)", "6.21"),
        ("Private", "Private (object 0x80 to 0xFF of Read Device Identification)", "6.21"),
    ],
)  # fmt: skip
def test_words_and_what_they_mean(word: str, title: str, section: str) -> None:
    """Several words explain the same thing."""
    found = explain(word)
    assert found.title == title
    assert found.section == SPECIFICATION + section
    assert all(text.strip() for text in found.text)
    assert title in str(found)


@pytest.mark.parametrize("code", sorted({row.code for row in functions()}))
def test_every_function_has_an_example_taken_apart(code: int) -> None:
    """Every function has an example with request, and response if it has one."""
    found = explain(str(code))
    assert found.kind == "function"
    assert any(line.startswith("request ") for line in found.example)
    assert any(line.startswith("response ") for line in found.example)


@pytest.mark.parametrize("finding", vocabulary.findings(), ids=lambda finding: finding.code)
def test_every_finding_is_explained(finding: vocabulary.Finding) -> None:
    """By its code; with the reason and what to check."""
    found = explain(finding.code)
    assert found.kind == "finding"
    assert finding.why in found.text
    assert finding.advice in "".join(found.text)


def test_every_known_word_is_explained() -> None:
    """Every word that hints may offer is explained."""
    assert all(explain(word).text for word in known_words())


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("Read Holding Regsters", "did you mean 'Read Holding Registers'"),
        ("illegal adress", "did you mean 'Illegal Data Address'"),
        ("xyzzy", "try 3, 'exception 2' or bad_checksum"),
        ("", "try 3, 'exception 2'"),
        ("fc 99", "function 99 is not known; choose from 1, 2, 3"),
        ("8/99", "no sub-function 99 in the table; choose from 0, 1, 2"),
        ("43/1", "no sub-function 1 in the table; choose from 13, 14"),
        ("3/1", "no sub-function 1 in the table; it has none"),
    ],
)
def test_unknown_words_get_a_hint(word: str, said: str) -> None:
    """An unknown word is reported with the most similar one, or the known ones."""
    with pytest.raises(UsageError, match=said):
        explain(word)


def test_vendors_functions_are_explained() -> None:
    """Vendors' functions are explained when their rows are given."""
    table = _modlens.Functions()
    table.load_vendor("huawei")
    found = explain("0x41/0x24", source=table)
    assert found.title == "Login Challenge (Huawei Private Function, sub_function 36)"
    assert found.section == "not in the specification; defined by the vendor"
    assert explain("Login Challenge", source=table) == found
    assert "36 Login Challenge" in str(explain("0x41", source=table))


def test_layouts_are_described_in_words() -> None:
    """Fields, limits, echoes, and what there is not."""
    text = "\n".join(explain("16").text)
    assert "Request: address (2 bytes), quantity (2 bytes), byte_count (1 byte: how many" in text
    assert "Permitted: quantity 1 to 123. The response repeats address, quantity." in text
    assert "There is no response." in "\n".join(explain("8/4").text)
    assert "not public" in "\n".join(explain("0x5A").text)


def test_a_word_that_is_a_finding_and_a_status_is_explained_as_both() -> None:
    """`no_response` is the code of a finding and the status of a transaction."""
    assert "As the status of a transaction: no response arrived" in str(explain("no_response"))


def test_a_bare_number_may_be_an_exception_too() -> None:
    """There is an exception 6, but no exception 16; what is said to be a function is one."""
    assert "modlens explain exception 6" in explain("6").text[-1]
    assert not any("exception 16" in text for text in (*explain("16").text, *explain("fc16").text))
    assert not any("explain exception" in text for text in explain("fc6").text)


@pytest.mark.parametrize("word", ["tables", "filters", "where"])
def test_nothing_far_fetched_is_offered(word: str) -> None:
    """Words for other parts of the program are no misspelled findings."""
    with pytest.raises(UsageError) as caught:
        explain(word)
    assert "did you mean" not in str(caught.value)
    assert "modlens explain list prints" in str(caught.value)


def test_a_damaged_response_leads_to_its_findings() -> None:
    assert "bad_checksum" in explain("bad_response").text[-1]
