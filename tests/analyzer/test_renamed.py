"""Former spellings of columns, statuses and findings are accepted as input, and never written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from analyzer import columns, decode, filters
from dissectors.errors import FilterError, UsageError
from dissectors.explain import explain
from dissectors.texts import respelled, vocabulary
from dissectors.vocabulary import findings, statuses
from tests.conftest import ROOT
from tests.docs.documents import rows_of_table

EXPORTED = Path(__file__).parent / "exports" / "schema_1.pcapng"
"""28 transactions as modlens exported them with schema 1, the version before the renaming."""

RENAMED = [(row["vocabulary"], row["former"], row["current"]) for row in vocabulary("renamed")]
COLUMNS = [(former, now) for what, former, now in RENAMED if what == "column"]
STATUSES = [(former, now) for what, former, now in RENAMED if what == "status"]
FINDINGS = [(former, now) for what, former, now in RENAMED if what == "finding"]


def test_the_document_has_the_same_table() -> None:
    rows = rows_of_table("docs/records.md", "| what | former |")
    assert [tuple(cell.strip("` |") for cell in row) for row in rows] == RENAMED


def test_the_document_explains_every_status() -> None:
    rows = rows_of_table("docs/records.md", "| `status` | meaning |")
    assert {row[0].strip("`"): row[1].rstrip(" |") for row in rows} == statuses()


def test_every_kind_is_in_the_table() -> None:
    assert COLUMNS
    assert STATUSES
    assert FINDINGS
    assert all(now in statuses() for _, now in STATUSES)
    assert {now for _, now in FINDINGS} <= {one.code for one in findings()}


@pytest.mark.parametrize(("former", "now"), COLUMNS)
def test_a_former_column_is_accepted(former: str, now: str) -> None:
    """Under `--columns`, in filters, and as an attribute of a row; the output has the new name."""
    table = next(
        name for name in columns.TABLES if now in {one.key for one in columns.columns(name)}
    )
    assert columns.pick(table, former) == (now,)
    text = f"{former} is not None"
    assert filters.parse(text, table).tree == filters.parse(f"{now} is not None", table).tree
    rows = list(getattr(decode(EXPORTED), table))
    assert rows
    assert [getattr(row, former) for row in rows] == [getattr(row, now) for row in rows]
    assert former not in rows[0].as_dict()


@pytest.mark.parametrize(("former", "now"), STATUSES)
@pytest.mark.parametrize(
    "text",
    [
        "status == '{}'",
        "'{}' != status",
        "status in ('ok', '{}')",
        "status in ('{}', 'ok', 'broadcast')",
        "not status == '{}'",
    ],
)
def test_a_former_status_is_accepted_in_filters(former: str, now: str, text: str) -> None:
    old, new = (filters.parse(text.format(word), "transactions").tree for word in (former, now))
    assert old == new
    assert former not in json.dumps(old)


@pytest.mark.parametrize(("former", "now"), FINDINGS)
@pytest.mark.parametrize(
    ("text", "table"),
    [
        ("'{}' in findings", "transactions"),
        ("'{}' not in findings", "frames"),
        ("code == '{}'", "findings"),
        ("code in ('retry', '{}')", "findings"),
    ],
)
def test_a_former_finding_is_accepted_in_filters(
    former: str, now: str, text: str, table: str
) -> None:
    old, new = (filters.parse(text.format(word), table).tree for word in (former, now))
    assert old == new
    assert now in json.dumps(new)


@pytest.mark.parametrize(("former", "now"), FINDINGS + STATUSES)
def test_a_former_word_is_explained(former: str, now: str) -> None:
    assert explain(former) == explain(now)
    assert now in explain(former).title


def test_other_words_stay_as_they_are() -> None:
    """A word is renamed in its own vocabulary only: a bus may be called `glitch`."""
    assert respelled("status", "glitch") == "glitch"
    assert "glitch" in json.dumps(filters.parse("bus == 'glitch'", "transactions").tree)
    with pytest.raises(FilterError):
        filters.parse("not_seen == 1", "transactions")
    with pytest.raises(UsageError):
        columns.pick("transactions", "cut_by")


def test_a_former_export_is_read_back() -> None:
    """The rows of the former version, which are written down here in today's words."""
    recording = decode(EXPORTED)
    frames, transactions = recording.frames, recording.transactions
    assert [row.unit for row in frames if row.unconfirmed] == [77]
    assert sorted(row.delimited_by for row in frames if row.delimited_by != "length") == [
        "frame", "frame", "silence", "silence", "silence",
    ]  # fmt: skip
    assert [(row.txn, row.status, row.late_response_to) for row in transactions
            if row.status not in ("ok", "no_response")] == [
        (11, "unsolicited", 9), (15, "unsolicited", 13), (19, "unsolicited", 17),
        (23, "bad_response", None), (25, "unsolicited", None), (28, "not_observed", None),
    ]  # fmt: skip
    found = [(row.frame, row.code, row.detail) for row in recording.findings if row.frame > 32]
    assert found == [
        (38, "stray_bytes", "one value next to a frame, as drivers give when they are switched"),
        (42, "bad_checksum", "found 5c44, expected 201f"),
        (47, "unconfirmed",
         "between bytes that are no frames, and the unit was in no paired transaction yet"),
        (47, "unsolicited", "unit 77"),
    ]  # fmt: skip
    assert next(iter(transactions.where("txn == 25"))).findings == ["unconfirmed", "unsolicited"]


def test_no_text_of_the_project_has_a_former_word() -> None:
    """What users read: texts of columns, findings and statuses, and the documents."""
    words = {former for _, former, _ in RENAMED} - {"evidence", "transaction_id"}
    texts = [str(row) for row in vocabulary("columns").values()]
    texts += [str(row) for row in (*vocabulary("findings"), *vocabulary("statuses"))]
    texts += [(ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/tap.md")]
    assert [word for word in sorted(words) for text in texts if f"`{word}`" in text] == []
    assert [word for word in sorted(words) for text in texts if f"'{word}'" in text] == []
