"""The judgement in other places: the document of `stats`, the advice of findings, a live tap."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from analyzer import decode
from analyzer.views.diagnostics import rank_findings
from dissectors.vocabulary import diagnosis, findings
from tests.conftest import CAPTURES, ROOT
from tests.doctor.captured import Capture, captures
from tests.doctor.examine import ran

ALL = list(captures())
SCHEMA = ROOT / "docs" / "stats.schema.json"


def command(capture: Capture) -> list[str]:
    return [str(CAPTURES / capture.file), *capture.words]


def follows_schema(document: object) -> None:
    """Check a document of `modlens stats`, or that of a report."""
    jsonschema = pytest.importorskip("jsonschema")
    referencing = pytest.importorskip("referencing")
    schema = json.loads(SCHEMA.read_text("utf-8"))
    doctor = json.loads((SCHEMA.parent / "doctor.schema.json").read_text("utf-8"))
    registry = referencing.Registry().with_resources(
        [("doctor.schema.json", referencing.jsonschema.DRAFT202012.create_resource(doctor))]
    )
    jsonschema.Draft202012Validator(schema, registry=registry).validate(document)


@pytest.mark.parametrize("name", ["pymodbus_slow_unit", "pymodbus_plant", "pymodbus_idle_close"])
def test_statistics_and_judgement_are_one_document(name: str, tmp_path: Path) -> None:
    """It follows its schema, and its members are what the two commands say by themselves."""
    capture = next(one for one in ALL if one.name == name)
    document = json.loads(ran("stats", *command(capture), "--to", "json", cwd=tmp_path))
    follows_schema(document)
    alone = json.loads(ran("doctor", *command(capture), "--to", "json", cwd=tmp_path))
    assert document["doctor"] == alone
    assert sum(document["statistics"]["transactions"].values()) >= alone["requests"]


@pytest.mark.parametrize("capture", ALL, ids=[capture.name for capture in ALL])
def test_the_advice_of_findings_does_not_contradict_the_cause(capture: Capture) -> None:
    """Where a diagnosis explains a finding, the advice names it, the most harmful one first."""
    given = dict(zip(capture.words[::2], capture.words[1::2], strict=True))
    decoding = decode(
        CAPTURES / capture.file, line=given.get("--line"), mode=given.get("--mode", "auto")
    )
    doctor, stats = decoding.doctor(), decoding.stats()
    general = {one.code: one.advice for one in findings()}
    for code, _, _, advice in rank_findings(stats, doctor):
        causes = [row for row in doctor["diagnoses"] if code in _explained(row["code"])]
        if causes:
            assert advice.startswith(f"Caused by {causes[0]['code']}")
        else:
            # Of an exception, the advice names the code where it is the only one.
            assert re.sub(r"exception \d+\.$", "exception N.", advice) == general[code]


@pytest.mark.parametrize("name", ["pymodbus_slow_unit", "pymodbus_idle_close"])
def test_markdown_has_all_that_json_has(name: str, tmp_path: Path) -> None:
    """Each diagnosis with its sentence, each unit with its timed answers and their clock."""
    capture = next(one for one in ALL if one.name == name)
    document = json.loads(ran("doctor", *command(capture), "--to", "json", cwd=tmp_path))
    written = ran("doctor", *command(capture), "--to", "md", cwd=tmp_path)
    lines = [line.strip("| ").split(" | ") for line in written.splitlines() if line[:1] == "|"]
    head, _, *cells = lines
    assert "Timed answers: from the end of the request to the start of the response" in written
    units = [dict(zip(head, row, strict=True)) for row in cells]
    assert len(units) == len(document["reserves"]) > 0
    for unit, row in zip(units, document["reserves"], strict=True):
        counts = ("unit", "requests", "answered", "timed", "late", "damaged")
        assert {key: int(unit[key]) for key in counts} == {key: row[key] for key in counts}
        assert (unit["clock"], row["clock"]) == ("UTC", "utc")
    plain = written.replace("\\", "")
    for row in document["diagnoses"]:
        assert row["sentence"] in plain
        assert row["advice"] in plain


def _explained(code: str) -> tuple[str, ...]:
    known = diagnosis(code)
    assert known is not None
    return known.findings


def test_two_units_with_one_address_are_no_matter_of_termination() -> None:
    """The advice that the field knows as wrong."""
    name = "captures/pymodbus_two_with_one_address/recording.jsonl"
    printed = ran("stats", ROOT / name, "--line", "57600-8E1", cwd=ROOT)
    assert "ermination" not in printed
    assert "Caused by duplicate_address of unit 2" in " ".join(printed.split())
