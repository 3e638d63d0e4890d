"""Every row of dissectors/diagnoses.toml has a recognizer, recordings, and an explanation."""

from __future__ import annotations

import json
import re
import tomllib

import pytest

from analyzer import decode
from dissectors.explain import explain
from dissectors.vocabulary import diagnoses, diagnosis
from tests.conftest import CAPTURES, ROOT
from tests.doctor.cases import KINDS

TABLE = ROOT / "dissectors" / "diagnoses.toml"
CRATE = ROOT / "crates" / "modlens-diagnosis" / "src"
COMMON_PLACES = {"subject", "unit", "failed", "total", "when"}
ROWS = tomllib.loads(TABLE.read_text(encoding="utf-8"))["diagnosis"]
CODES = [row["code"] for row in ROWS]


def test_the_core_has_the_rows_of_the_file() -> None:
    assert [one.code for one in diagnoses()] == CODES


@pytest.mark.parametrize("code", CODES)
def test_a_kind_is_recognized_recorded_and_explained(code: str) -> None:
    """A function of its name, a generator of recordings, and all that the row says in words."""
    sources = "".join(path.read_text("utf-8") for path in sorted((CRATE / "kinds").glob("*.rs")))
    assert f"pub(super) fn {code}(" in sources
    assert code in KINDS
    text = str(explain(code))
    entry = diagnosis(code)
    assert entry is not None
    for part in (entry.contrast, entry.absent, entry.needs):
        assert part in text
    for other, difference in entry.confusions:
        assert other in CODES
        assert f"{other}: {difference}" in text


@pytest.mark.parametrize("capture", ["pymodbus_disturbed", "pymodbus_plant", "pymodbus_timeouts"])
def test_the_document_follows_its_schema(capture: str) -> None:
    """The keys of each part are those of docs/doctor.schema.json, the types as well."""
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((ROOT / "docs" / "doctor.schema.json").read_text("utf-8"))
    found = decode(CAPTURES / capture / "recording.jsonl", line="19200-8E1").doctor()
    jsonschema.validate(found, schema)
    assert found["requests"] > 0


def test_shares_are_those_of_the_transactions() -> None:
    """`failed` and `requests` as counted in the table of transactions; examples are failures."""
    recording = decode(CAPTURES / "pymodbus_timeouts" / "recording.jsonl")
    rows = [row for row in recording.transactions if row.status not in ("unsolicited",)]
    known = [row for row in rows if row.status not in ("broadcast", "not_observed")]
    silent = {row.txn for row in known if row.status == "no_response"}
    found = recording.doctor()
    assert (found["requests"], found["failed"]) == (len(known), len(silent))
    worst = found["diagnoses"][0]
    assert (worst["code"], worst["unit"]) == ("dead_unit_cost", 3)
    assert worst["failed"] == worst["total"] == len(silent)
    assert set(worst["examples"]) <= silent


@pytest.mark.parametrize("row", ROWS, ids=CODES)
def test_each_place_of_a_sentence_is_filled(row: dict[str, str]) -> None:
    """By all kinds, or by a fact of the recognizer."""
    sources = "".join(path.read_text("utf-8") for path in sorted((CRATE / "kinds").glob("*.rs")))
    facts = set(re.findall(r'\.fact\(\s*"(\w+)"', sources))
    for key in ("sentence", "advice", "proof"):
        places = set(re.findall(r"{(\w+)}", row[key]))
        assert places <= COMMON_PLACES | facts, (row["code"], places - COMMON_PLACES - facts)
