"""What filters select: the core's answer against the obvious one in Python."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from analyzer import decode

RECORDING = "pymodbus_exceptions"

Expected = Any

SELECTIONS: list[tuple[str, Expected]] = [
    ("unit == 1", lambda row: row.unit == 1),
    ("unit != 1", lambda row: row.unit is not None and row.unit != 1),
    ("status != 'ok'", lambda row: row.status != "ok"),
    ("exception is None", lambda row: row.exception is None),
    ("exception is not None and exception > 2", lambda row: (row.exception or 0) > 2),
    ("not exception > 2", lambda row: not (row.exception or 0) > 2),
    ("exception in (2, 3)", lambda row: row.exception in (2, 3)),
    ("exception not in (2, 3)", lambda row: row.exception not in (None, 2, 3)),
    ("'exception' in findings", lambda row: "exception" in row.findings),
    ("'exception' not in findings", lambda row: "exception" not in row.findings),
    ("'Write' in function_name", lambda row: "Write" in (row.function_name or "")),
    ("4660 in write_data", lambda row: 4660 in (row.write_data or ())),
    ("response_time_us > 5e3", lambda row: (row.response_time_us or 0) > 5e3),
    ("response_time_us / 1000 <= 5", lambda row: 0 < (row.response_time_us or 0) <= 5e3),
    ("function & 1 == 1", lambda row: row.function & 1 == 1),
    (
        "function % 4 == 2 or function // 4 == 0",
        lambda row: row.function % 4 == 2 or row.function < 4,
    ),
    ("-function < -10", lambda row: row.function > 10),
    ("quantity / 0 == 1", lambda row: False),
    ("touches(hr, 8)", lambda row: _touches(row, "holding_register", 8, 8)),
    ("touches(hr, range(1000, 1100))", lambda row: _touches(row, "holding_register", 1000, 1099)),
    ("writes(hr, range(1000, 1100))", lambda row: _writes(row, "holding_register", 1000, 1099)),
    ("writes(hr, '40003')", lambda row: _writes(row, "holding_register", 2, 2)),
    ("address == '40009'", lambda row: (row.address, row.register_type) == (8, "holding_register")),
    (
        "write_address != '40003'",
        lambda row: (
            row.write_address is not None
            and (row.write_address, row.register_type) != (2, "holding_register")
        ),
    ),
    ("fields is not None", lambda row: row.fields is not None),
    ("'0103' in request_hex", lambda row: "0103" in (row.request_hex or b"").hex()),
    ("source == 'x' or txn == 3", lambda row: row.txn == 3),
    (
        "time < '2026-11-21T11:13:02Z'",
        lambda row: row.time < datetime(2026, 11, 21, 11, 13, 2, tzinfo=UTC),
    ),
    ("1 <= txn < 4 and not (txn == 2)", lambda row: row.txn in (1, 3)),
]


def _writes(row: Any, kind: str, first: int, last: int) -> bool:
    return row.register_type == kind and _meets(row.write_address, row.write_quantity, first, last)


def _touches(row: Any, kind: str, first: int, last: int) -> bool:
    reads = row.register_type == kind and _meets(row.address, row.quantity, first, last)
    return reads or _writes(row, kind, first, last)


def _meets(start: int | None, quantity: int | None, first: int, last: int) -> bool:
    return start is not None and start <= last and start + (quantity or 1) > first


@pytest.mark.parametrize(("text", "expected"), SELECTIONS)
def test_a_filter_selects_what_it_says(text: str, expected: Expected, captures: Path) -> None:
    """Row for row, with exceptions, gaps and all functions in the recording."""
    recording = decode(captures / RECORDING / "recording.jsonl", line="19200-8E1")
    wanted = [row.txn for row in recording if expected(row)]
    assert [row.txn for row in recording.transactions.where(text)] == wanted


def test_filters_add_up(captures: Path) -> None:
    """A filtered table can be filtered again."""
    rows = decode(captures / RECORDING / "recording.jsonl").transactions
    both = rows.where("unit == 1").where("exception == 2")
    assert [row.txn for row in both] == [
        row.txn for row in rows.where("unit == 1 and exception == 2")
    ]


def test_bool_columns_are_conditions(captures: Path) -> None:
    """A bool column may be a condition, or be compared with a number."""
    frames = decode(captures / "pymodbus_disturbed" / "recording.jsonl").frames
    wanted = [row.frame for row in frames if row.unconfirmed]
    assert [row.frame for row in frames.where("unconfirmed")] == wanted
    assert [row.frame for row in frames.where("unconfirmed == 1")] == wanted
