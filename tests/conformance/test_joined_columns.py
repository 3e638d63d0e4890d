"""The columns of joined rows are those that the core makes, with the types of transactions."""

from __future__ import annotations

import re
from pathlib import Path

from analyzer.columns import columns
from analyzer.joining import joined_columns, outcomes

SOURCES = Path(__file__).parents[2] / "crates" / "modlens-watch" / "src" / "join"


def source(name: str) -> str:
    """A file of the core, without its tests."""
    return (SOURCES / name).read_text().partition("#[cfg(test)]")[0]


def copied() -> set[str]:
    """The columns that the core copies from a transaction."""
    _, _, rest = source("exchange.rs").partition("const COPIED")
    return set(re.findall(r'"(\w+)"', rest.partition("];")[0]))


def test_every_column_is_made_by_the_core() -> None:
    made = set(re.findall(r'row\.insert\("(\w+)"', source("rows.rs")))
    # The time leaves the core as a number.
    assert {*made, *copied()} - {"time_ns"} | {"time"} == {one.key for one in joined_columns()}


def test_columns_of_transactions_have_their_types() -> None:
    known = {one.key: one for one in columns("transactions")}
    same = [one for one in joined_columns() if one.key in known]
    assert {one.key: one.type for one in same} == {one.key: known[one.key].type for one in same}
    # What is copied is described where transactions are.
    assert all(one == known[one.key] for one in same if one.key in copied())


def test_every_outcome_is_explained() -> None:
    text = source("verdict.rs") + source("rows.rs")
    said = set(re.findall(r'(?:plain\(|outcome: |verdict\()"(\w+)"', text))
    said |= {"own_request", "not_covered"} if '"own_request"' in source("rows.rs") else set()
    assert said == set(outcomes())
