"""Partitioned Parquet is one table for pandas, pyarrow, polars and duckdb, the bus included."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import CAPTURES, Modlens

BUSES = ("pymodbus_ascii", "pymodbus_timeouts")

Read = Callable[[Path], list[dict[str, Any]]]


def by_pandas(folder: Path) -> list[dict[str, Any]]:
    """By `pandas.read_parquet`, without an option."""
    pandas: Any = pytest.importorskip("pandas")
    found: list[dict[str, Any]] = pandas.read_parquet(folder).to_dict("records")
    return found


def by_pyarrow(folder: Path) -> list[dict[str, Any]]:
    """By `pyarrow.parquet.read_table`, without an option."""
    parquet = pytest.importorskip("pyarrow.parquet")
    found: list[dict[str, Any]] = parquet.read_table(folder).to_pylist()
    return found


def by_polars(folder: Path) -> list[dict[str, Any]]:
    """By `polars.read_parquet`, which takes folders for partitions by itself."""
    polars: Any = pytest.importorskip("polars")
    found: list[dict[str, Any]] = polars.read_parquet(folder).to_dicts()
    return found


def by_duckdb(folder: Path) -> list[dict[str, Any]]:
    """By a pattern of names, without an option."""
    duckdb: Any = pytest.importorskip("duckdb")
    found = duckdb.sql(f"SELECT * REPLACE (time::VARCHAR AS time) FROM '{folder}/**/*.parquet'")
    return [dict(zip(found.columns, row, strict=True)) for row in found.fetchall()]


READERS = (by_pandas, by_pyarrow, by_polars, by_duckdb)


@pytest.fixture
def folder(tmp_path: Path, modlens: Modlens) -> Path:
    """The transactions of two recordings with dates, by date and bus."""
    path = tmp_path / "log.parquet"
    names = [CAPTURES / bus / "recording.jsonl" for bus in BUSES]
    assert modlens("export", *names, "--style", "partitions", "-o", path).status == 0
    return path


@pytest.mark.parametrize("read", READERS)
def test_every_row_is_read_with_its_bus(read: Read, folder: Path, modlens: Modlens) -> None:
    """As many rows of each bus as the CSV of each recording has."""
    rows = read(folder)
    for bus in BUSES:
        name = CAPTURES / bus / "recording.jsonl"
        lines = modlens("export", name, "--to", "csv", "--columns", "txn").out.splitlines()
        assert sum(row["bus"] == str(name) for row in rows) == len(lines) - 1, bus
    assert {str(row["date"]) for row in rows} <= {str(row["time"])[:10] for row in rows}


@pytest.mark.parametrize("read", READERS)
def test_rows_without_a_date_are_read(read: Read, tmp_path: Path, modlens: Modlens) -> None:
    """Their date is `unknown`: pyarrow refuses Hive's name of a partition without a value."""
    path = tmp_path / "log.parquet"
    source = CAPTURES / "seed_rtu" / "recording.hex"
    assert modlens("export", source, "--style", "partitions", "-o", path).status == 0
    rows = read(path)
    assert rows
    assert {row["date"] for row in rows} == {"unknown"}
    assert {row["bus"] for row in rows} == {str(source)}


def test_partitions_have_a_column_beside_the_bus(tmp_path: Path, modlens: Modlens) -> None:
    """Files without a column would say nothing."""
    path = tmp_path / "log.parquet"
    source = CAPTURES / "seed_rtu" / "recording.hex"
    done = modlens(
        "export", source, "--style", "partitions", "--columns", "bus", "-o", path
    )  # fmt: skip
    assert done.status == 2
    assert "--columns bus: it is in the path of each file" in done.err
    assert not path.exists()


def test_a_mixture_of_rows_with_and_without_a_date(tmp_path: Path, modlens: Modlens) -> None:
    """Every reader takes both kinds of partitions as one table."""
    path = tmp_path / "log.parquet"
    names = [CAPTURES / "seed_rtu" / "recording.hex", CAPTURES / BUSES[0] / "recording.jsonl"]
    assert modlens("export", *names, "--style", "partitions", "-o", path).status == 0
    for read in READERS:
        rows = read(path)
        missing = {row["bus"] for row in rows if row["date"] == "unknown"}
        assert missing == {str(names[0])}, read
        assert {row["bus"] for row in rows} == {str(name) for name in names}, read
