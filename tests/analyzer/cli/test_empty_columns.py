"""A chosen column without a value in any row is said once, at the end, with what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer.columns import TABLES, columns
from tests.conftest import Modlens

READ = "01 03 00 00 00 01 84 0A\n01 03 02 00 2A 39 9B\n"
"""Unit 1, holding register 0 is 42; a log without times."""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "bus.hex"
    path.write_text(READ * 2)
    return path


def test_each_empty_column_is_said_with_its_reason(modlens: Modlens, log: Path) -> None:
    done = modlens("export", log, "--to", "csv", "--columns", "unit,response_time_us,client,data")
    assert done.status == 0
    assert done.out.splitlines()[1:] == ["1,,,42"] * 2
    said = done.err.splitlines()
    assert [line.split(" is empty in all 2 rows: ")[0] for line in said] == [
        "modlens: standard output: client",
        "modlens: standard output: response_time_us",
    ]
    assert "tap --record" in said[1]


def test_a_filter_may_empty_a_column(modlens: Modlens, log: Path) -> None:
    """What counts are the rows that were written; none at all is another matter."""
    chosen = ("--columns", "address,write_data", "--to", "csv")
    done = modlens("export", log, *chosen, "--limit", 1)
    assert "write_data is empty in the only row: nothing was written" in done.err
    assert modlens("export", log, *chosen, "--where", "unit == 9").err == ""


@pytest.mark.parametrize("table", TABLES)
def test_every_column_can_be_watched(modlens: Modlens, log: Path, table: str) -> None:
    """All columns of a table, chosen: those that are always there are never said."""
    keys = ",".join(column.key for column in columns(table))
    done = modlens("export", log, "--table", table, "--to", "csv", "--columns", keys)
    assert done.status == 0
    always = {column.key for column in columns(table) if column.always}
    said = {line.split()[3] for line in done.err.splitlines()}
    assert not said & always
    assert "time" in said or len(done.out.splitlines()) == 1


def test_columns_that_nobody_chose_are_not_said(modlens: Modlens, log: Path) -> None:
    assert modlens("export", log, "--to", "csv").err == ""
