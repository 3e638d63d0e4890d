"""What a diagnosis says is what a count of the exported transactions gives: n of N, since when."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.doctor.cases import Case, make
from tests.doctor.examine import diagnose, ran, written

Row = dict[str, Any]
SEEDS = (1, 2)
BUSY = {5, 6, 10, 11}
UNKNOWN = ("unsolicited", "unrequested", "not_observed", "not_seen")
"""Nobody asked, or the recording ended before an answer could come."""
OF_ONE_BLOCK = ("register_hole", "wrong_function")
"""What is said is about the block that was refused."""


@dataclass(frozen=True, slots=True)
class Count:
    """Which transactions a diagnosis is about, and which of them bear the trouble."""

    concerns: Callable[[Row, Row], bool]
    bears: Callable[[Row, Row], bool]


def of_unit(row: Row, told: Row) -> bool:
    return bool(row.get("unit") == told["unit"])


def of_unit_and_function(row: Row, told: Row) -> bool:
    return bool(of_unit(row, told) and told.get("function") in (None, row["function"]))


def block_of(row: Row) -> tuple[int | None, int | None]:
    return row.get("address"), row.get("quantity")


def unanswered(row: Row, told: Row) -> bool:
    return bool(row["status"] == "no_response")


def any_request(row: Row, told: Row) -> bool:
    return True


def failed(row: Row, told: Row) -> bool:
    return bool(row["status"] in ("no_response", "bad_response", "bad_request"))


def refused(*codes: int) -> Callable[[Row, Row], bool]:
    return lambda row, told: row.get("exception") in codes


COUNTS: Mapping[str, Count] = {
    "dead_unit_cost": Count(of_unit, unanswered),
    "device_absent": Count(of_unit, unanswered),
    "device_busy": Count(of_unit_and_function, refused(*BUSY)),
    "register_hole": Count(of_unit_and_function, refused(2)),
    "two_masters": Count(any_request, failed),
    "wrong_function": Count(of_unit_and_function, refused(1, 2)),
}


@pytest.fixture(params=SEEDS)
def seed(request: pytest.FixtureRequest) -> int:
    """Each in turn."""
    number: int = request.param
    return number


@pytest.fixture(params=list(COUNTS))
def examined(request: pytest.FixtureRequest, seed: int, tmp_path: Path) -> tuple[Row, list[Row]]:
    """The diagnosis of that kind, and all transactions."""
    kind = request.param
    case = make(kind, seed)
    written(case, tmp_path)
    rows = diagnose(case.main, case.words, tmp_path)
    told = next((row for row in rows if row["code"] == kind), None)
    assert told is not None, [row["sentence"] for row in rows]
    return told, transactions(case, tmp_path)


def transactions(case: Case, folder: Path) -> list[Row]:
    out = ran("decode", case.main, *case.words, "--to", "jsonl", cwd=folder)
    return [json.loads(line) for line in out.splitlines()]


def test_numbers_are_those_of_the_export(examined: tuple[Row, list[Row]]) -> None:
    told, rows = examined
    count = COUNTS[told["code"]]
    concerned = [row for row in rows if count.concerns(row, told) and row["status"] not in UNKNOWN]
    if told["code"] in OF_ONE_BLOCK:
        block = block_of(next(row for row in rows if row["txn"] in told["examples"]))
        concerned = [row for row in concerned if block_of(row) == block]
    bearing = [row for row in concerned if count.bears(row, told)]
    assert told["failed"] == len(bearing)
    assert told["total"] == len(concerned)
    assert told["since"] == bearing[0]["time"]


def test_the_sentence_has_the_same_numbers(examined: tuple[Row, list[Row]]) -> None:
    told, _ = examined
    plain = told["sentence"].replace(",", "")
    pairs = [(int(n), int(total)) for n, total in re.findall(r"(\d+) of (?:\w+ )?(\d+)", plain)]
    assert (told["failed"], told["total"]) in pairs, told["sentence"]


def test_examples_are_transactions_that_bear_it(examined: tuple[Row, list[Row]]) -> None:
    told, rows = examined
    by_number = {row["txn"]: row for row in rows}
    count = COUNTS[told["code"]]
    assert told["examples"]
    for number in told["examples"]:
        assert count.concerns(by_number[number], told)
        assert count.bears(by_number[number], told)


MET = {
    r"([\d,]+) (?:was|were) sent while another one was open": ("transactions", "two_masters"),
    r"([\d,]+) frames? collided": ("frames", "collision"),
}


def test_what_met_is_what_the_exports_count(seed: int, tmp_path: Path) -> None:
    case = make("two_masters", seed)
    written(case, tmp_path)
    rows = diagnose(case.main, case.words, tmp_path)
    sentence = next(row["sentence"] for row in rows if row["code"] == "two_masters")
    said = [(number, what) for words, what in MET.items() for number in re.findall(words, sentence)]
    assert said, sentence
    for number, (table, finding) in said:
        words = ("--table", table, "--to", "jsonl")
        lines = ran("decode", case.main, *case.words, *words, cwd=tmp_path).splitlines()
        bearing = [row for row in map(json.loads, lines) if finding in (row.get("findings") or ())]
        assert int(number.replace(",", "")) == len(bearing)
