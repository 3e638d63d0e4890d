"""A seed of each kind and near confusion, and healthy lines: the doctor says what is wrong.

`python -m tests.doctor.score` does the same with many seeds, and shows how often it is right.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import CAPTURES
from tests.doctor.captured import TROUBLED, captures, healthy_captures
from tests.doctor.cases import COUNTER_CASES, KINDS, make
from tests.doctor.examine import diagnose, examine, ran, subject_fits, written
from tests.doctor.healthy import LINES, healthy_line

SEED = 1
LINES_A_TEST = 5
BEYOND_REACH = {
    "a float that straddles two quantities": "two registers that are halves of different floats"
    " look like one float in another order of words; the counters keep no series of values that"
    " could tell the two apart",
}
"""Near confusions that the doctor cannot tell, with the reason."""


def _case(name: str) -> object:
    why = BEYOND_REACH.get(name)
    marks = [] if why is None else [pytest.mark.xfail(reason=why, strict=True)]
    return pytest.param(name, id=name, marks=marks)


WORDS = {capture.name: (capture.file, capture.words) for capture in captures()}


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_is_named_first_with_its_subject(name: str) -> None:
    case = make(name, SEED)
    outcome = examine(case)
    assert outcome.place == 1, [row["sentence"] for row in outcome.rows]
    assert outcome.fits, (case.expected, outcome.rows[0])


@pytest.mark.parametrize("name", [_case(name) for name in COUNTER_CASES])
def test_neighbours_are_not_confused(name: str) -> None:
    case = make(name, SEED)
    outcome = examine(case)
    said = [row["sentence"] for row in outcome.rows]
    assert outcome.place == 1 if case.expected else not outcome.confused, said


@pytest.mark.parametrize("name", TROUBLED)
def test_what_was_recorded_because_of_a_trouble_is_named_first(name: str) -> None:
    file, words = WORDS[name]
    rows = diagnose(file, words, CAPTURES)
    assert rows, name
    assert subject_fits(rows[0], TROUBLED[name]), [row["sentence"] for row in rows]


@pytest.mark.parametrize("first", range(1, LINES + 1, LINES_A_TEST))
def test_healthy_lines_are_healthy(first: int) -> None:
    """No diagnosis of severity error, with a damaged frame in a thousand at most."""
    for number in range(first, min(first + LINES_A_TEST, LINES + 1)):
        outcome = examine(healthy_line(number))
        assert not outcome.errors, (number, [row["sentence"] for row in outcome.rows])


@pytest.mark.parametrize("name", [capture.name for capture in healthy_captures()])
def test_healthy_captures_are_healthy(name: str) -> None:
    rows = diagnose(*WORDS[name], CAPTURES)
    assert [row["sentence"] for row in rows if row["severity"] == "error"] == []


def test_the_command_says_the_same(tmp_path: Path) -> None:
    """What the tests here look at, by way of Python, is what `modlens doctor` prints."""
    case = make("device_busy", SEED)
    written(case, tmp_path)
    printed = json.loads(ran("doctor", case.main, *case.words, "--to", "json", cwd=tmp_path))
    told = diagnose(case.main, case.words, tmp_path)
    assert [row["sentence"] for row in printed["diagnoses"]] == [row["sentence"] for row in told]
