"""What is odd in the middle of ordinary traffic is reported there, however it was recorded.

Nearly all traffic is plain exchanges, which the engine decides on its fast path. These tests walk
all findings and all columns, so that they fail for what is added to the slow path alone. A new
finding needs an example in `finding_examples.py`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache

import pytest

import _modlens
from tests.conformance.finding_examples import EXAMPLES, NOT_BETWEEN_EXCHANGES
from tests.support.ordinary_traffic import COLUMNS, PLAIN, RECORDINGS, TABLES, Decoded, decoded

CASES = [(code, name) for code, example in EXAMPLES.items() for name in example.recordings]
NEVER_IN_THEM = {
    "frames": {"line"},  # two-line taps only
    "connections": {"closed"},
}


@cache
def between(code: str, recording: str, *, frames: bool, block: int | None = None) -> Decoded:
    """An example between ten plain exchanges and ten more, twice: its requests are known then."""
    example = EXAMPLES[code]
    messages = (*PLAIN, *example.messages, *PLAIN, *example.messages, *PLAIN)
    return decoded(messages, recording, frames=frames, block=block, profile=example.profile)


def test_every_finding_has_its_example() -> None:
    """A new finding needs one, or a reason why it cannot be between exchanges."""
    declared = {finding["code"] for finding in json.loads(_modlens.vocabulary("findings"))}
    assert set(EXAMPLES) | set(NOT_BETWEEN_EXCHANGES) == declared
    assert not set(EXAMPLES).intersection(NOT_BETWEEN_EXCHANGES)


@pytest.mark.parametrize("recording", RECORDINGS)
def test_plain_exchanges_have_no_finding(recording: str) -> None:
    """Twenty exchanges, all answered; otherwise the tests below would show little."""
    found = decoded(PLAIN * 2, recording, frames=True)
    assert [row["status"] for row in found.tables["transactions"]] == ["ok"] * 20
    assert not found.codes()


@pytest.mark.parametrize(("code", "recording"), CASES)
def test_a_finding_is_reported_between_plain_exchanges(code: str, recording: str) -> None:
    """In the table of findings and in the statistics, with and without frames wanted."""
    for frames in (True, False):
        found = between(code, recording, frames=frames)
        assert code in found.codes(), f"frames wanted: {frames}"
        assert found.statistics["findings"][code] > 0


@pytest.mark.parametrize(("code", "recording"), CASES)
def test_fast_and_slow_path_give_the_same_rows_and_counters(code: str, recording: str) -> None:
    """The slow path is the oracle: for all tables, statistics, and counters of the doctor."""
    for frames in (True, False):
        fast, slow = (between(code, recording, frames=frames, block=it) for it in (None, 1))
        assert fast == slow, f"frames wanted: {frames}"
    wanted, unwanted = (between(code, recording, frames=frames) for frames in (True, False))
    assert {**unwanted.tables, "frames": wanted.tables["frames"]} == wanted.tables
    assert unwanted.statistics == wanted.statistics


@pytest.mark.parametrize("table", TABLES)
def test_every_column_has_a_value_in_them(table: str) -> None:
    """A column that is empty in all of this traffic would be compared in vain."""
    filled = {key for row in _rows(table) for key, value in row.items() if value not in (None, [])}
    assert filled | NEVER_IN_THEM.get(table, set()) == set(COLUMNS[table])


def _rows(table: str) -> Iterator[dict[str, object]]:
    for code, recording in CASES:
        yield from between(code, recording, frames=True).tables[table]
