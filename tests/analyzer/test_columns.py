"""Columns, read back from the core."""

from __future__ import annotations

import pytest

from analyzer import UsageError
from analyzer.columns import TABLES, columns, pick


@pytest.mark.parametrize("table", TABLES)
def test_every_column_is_explained(table: str) -> None:
    """Every column has a unique key, a title and a help text."""
    found = columns(table)
    assert all(column.key and column.title and column.help for column in found)
    assert len({column.key for column in found}) == len(found)


def test_columns_are_picked_in_the_order_asked_for() -> None:
    """Columns are given in the order asked for, all of them by default."""
    assert pick("findings", "code , frame") == ("code", "frame")
    assert pick("findings", None) == tuple(column.key for column in columns("findings"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("unti", "no column 'unti' in frames; did you mean 'unit'?"),
        ("qqq", "no column 'qqq' in frames; the columns are frame, time,"),
        (" , ", "--columns names no column"),
    ],
)
def test_unknown_columns_are_reported(text: str, message: str) -> None:
    """An unknown column is reported with a similar name, or all names."""
    with pytest.raises(UsageError, match=message.replace("?", r"\?")):
        pick("frames", text)
