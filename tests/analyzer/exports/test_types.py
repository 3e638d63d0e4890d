"""What readers of Parquet and Arrow files make of the types of columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from analyzer import decode
from analyzer.columns import TABLES, columns
from analyzer.exports.sink import ExportSink, parse_target
from tests.conftest import recording_with

# By the types of columns.toml: as Arrow (pyarrow), polars, duckdb and pandas name them.
NAMES = {
    "int": ("int64", "Int64", "BIGINT"),
    "us": ("double", "Float64", "DOUBLE"),
    "float": ("double", "Float64", "DOUBLE"),
    "time": (
        "timestamp[ns, tz=UTC]",
        "Datetime(time_unit='ns', time_zone='UTC')",
        "TIMESTAMPTZ_NS",
    ),
    "bool": ("bool", "Boolean", "BOOLEAN"),
    "text": ("string", "String", "VARCHAR"),
    "hex": ("string", "String", "VARCHAR"),
    "map": ("string", "String", "VARCHAR"),
    "ints": ("list<item: int32>", "List(Int32)", "INTEGER[]"),
    "texts": ("list<item: string>", "List(String)", "VARCHAR[]"),
}


@pytest.fixture
def files(tmp_path: Path, captures: Path) -> Path:
    """All tables of a recording, in both formats."""
    for table in TABLES:
        source = decode(captures / "pymodbus_all_functions" / "recording.jsonl")
        if table == "connections":
            source = decode(recording_with(table))
        for suffix in ("parquet", "arrow"):
            one = parse_target(str(tmp_path / f"{table}.{suffix}"), table)
            sink = ExportSink(one, columns=None, where=None, growing=False)
            for batch in source.batches(*TABLES):
                sink.put(batch)
            sink.close()
    return tmp_path


def named(table: str, reader: int) -> dict[str, str]:
    """Each column with its type as a reader names it."""
    return {column.key: NAMES[column.type][reader] for column in columns(table)}


@pytest.mark.parametrize("table", TABLES)
def test_pyarrow_has_the_same_schema_of_both_formats(table: str, files: Path) -> None:
    """Names, types and what is said of the writer."""
    parquet, ipc = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow.ipc")
    schema = parquet.read_schema(files / f"{table}.parquet")
    assert {field.name: str(field.type) for field in schema} == named(table, 0)
    arrow = ipc.open_file((files / f"{table}.arrow").read_bytes()).schema
    assert schema.equals(arrow, check_metadata=True)
    assert schema.metadata[b"modlens.table"] == table.encode()


@pytest.mark.parametrize("table", TABLES)
def test_polars_knows_the_types(table: str, files: Path) -> None:
    """Times in UTC, lists."""
    polars: Any = pytest.importorskip("polars")
    found = polars.read_parquet(files / f"{table}.parquet").schema
    assert {key: str(one) for key, one in found.items()} == named(table, 1)


@pytest.mark.parametrize("table", TABLES)
def test_duckdb_knows_the_types(table: str, files: Path) -> None:
    """Times in UTC, lists; what is said of the writer is there for it as well."""
    duckdb = pytest.importorskip("duckdb")
    path = files / f"{table}.parquet"
    found = duckdb.sql(f"DESCRIBE FROM '{path}'").fetchall()
    assert {row[0]: row[1] for row in found} == named(table, 2)
    said = duckdb.sql(f"SELECT key, value FROM parquet_kv_metadata('{path}')").fetchall()
    assert dict(said)[b"modlens.table"] == table.encode()


def test_pandas_has_times_with_a_zone(files: Path) -> None:
    """Not numbers, and not local time."""
    pandas: Any = pytest.importorskip("pandas")
    found = pandas.read_parquet(files / "frames.parquet")
    assert str(found["time"].dtype) == "datetime64[ns, UTC]"
    assert str(found["unconfirmed"].dtype) == "bool"
