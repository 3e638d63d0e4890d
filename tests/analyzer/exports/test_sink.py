"""Exports: what is asked for by `-o`, and what is written."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from analyzer import FilterError, SourceError, UsageError, decode
from analyzer.exports import ExportOptions
from analyzer.exports.sink import ExportSink, Target, check_style, parse_target


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("log.csv", Target("transactions", "csv", "log.csv")),
        ("frames:log.JSONL", Target("frames", "jsonl", "log.JSONL")),
        ("C:/logs/log.csv", Target("transactions", "csv", "C:/logs/log.csv")),
        ("findings:C:/log.csv", Target("findings", "csv", "C:/log.csv")),
    ],
)
def test_an_output_says_table_format_and_path(text: str, expected: Target) -> None:
    """The table may be in front; a drive letter is none."""
    assert parse_target(text, "transactions") == expected


@pytest.mark.parametrize("text", ["log", "log.cvs", "frames:", "log.csv.gz", ".csv"])
def test_a_suffix_that_says_nothing(text: str) -> None:
    """An unknown suffix is reported with the known ones."""
    with pytest.raises(UsageError, match=r"one of \.csv, "):
        parse_target(text, "transactions")


def export(path: Path, captures: Path, *, columns: str | None, where: str | None) -> ExportSink:
    """Write the transactions of a recording."""
    sink = ExportSink(
        parse_target(str(path), "transactions"), columns=columns, where=where, growing=False
    )
    recording = decode(captures / "pymodbus_exceptions" / "recording.jsonl", line="19200-8E1")
    for batch in recording.batches("transactions"):
        sink.put(batch)
    sink.close()
    return sink


def rows_of(path: Path) -> list[dict[str, Any]]:
    """What another program reads."""
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.mark.parametrize("suffix", ["csv", "jsonl"])
def test_columns_and_rows_are_chosen(suffix: str, tmp_path: Path, captures: Path) -> None:
    """The export has the chosen columns in the given order, and the filtered rows."""
    path = tmp_path / f"out.{suffix}"
    sink = export(path, captures, columns="status,txn", where="status == 'exception'")
    found = rows_of(path)
    assert sink.row_count == len(found) > 5
    assert all(list(row) == ["status", "txn"] and row["status"] == "exception" for row in found)


def test_without_rows_there_is_a_header(tmp_path: Path, captures: Path) -> None:
    """An empty CSV still says its columns; an empty JSONL is empty."""
    for suffix, size in (("csv", len("txn,unit\r\n")), ("jsonl", 0)):
        path = tmp_path / f"out.{suffix}"
        export(path, captures, columns="txn,unit", where="unit == 99")
        assert path.stat().st_size == size


def test_a_wrong_filter_or_column_opens_no_file(tmp_path: Path, captures: Path) -> None:
    """Invalid filters and columns are reported before a file is created."""
    with pytest.raises(FilterError, match="no column 'verdict'"):
        export(tmp_path / "out.csv", captures, columns=None, where="verdict == 'ok'")
    with pytest.raises(UsageError, match="no column 'verdict'"):
        export(tmp_path / "out.csv", captures, columns="verdict", where=None)
    assert list(tmp_path.iterdir()) == []


def test_partitions_are_folders_by_day_and_bus(tmp_path: Path, captures: Path) -> None:
    """What Hive's readers take as one table, with the two columns that the folders name."""
    dataset = pytest.importorskip("pyarrow.dataset")
    folder = tmp_path / "log.parquet"
    names = [
        captures / name / "recording.jsonl" for name in ("pymodbus_ascii", "pymodbus_timeouts")
    ]
    sink = ExportSink(
        parse_target(str(folder), "transactions"),
        columns=None, where=None, growing=False, options=ExportOptions("", (), style="partitions"),
    )  # fmt: skip
    recording = decode(names)
    for batch in recording.batches("transactions"):
        sink.put(batch)
    sink.close()
    days = {f"date={row.time.date().isoformat()}" for row in recording.transactions}
    assert {one.name for one in folder.iterdir()} == days
    assert len(list(folder.glob("date=*/bus=*/part-0.parquet"))) == 2
    found = dataset.dataset(str(folder), partitioning="hive").to_table(columns=["txn", "status"])
    rows = sorted(zip(*(column.to_pylist() for column in found.columns), strict=True))
    assert rows == [(row.txn, row.status) for row in recording.transactions]
    with pytest.raises(SourceError, match="no new folder can be created there"):
        ExportSink(
            parse_target(str(folder), "transactions"),
            columns=None, where=None, growing=False,
            options=ExportOptions("", (), style="partitions"),
        )  # fmt: skip


def test_parquet_says_where_it_comes_from(tmp_path: Path, captures: Path) -> None:
    """Table, version of the columns, program; few values have a dictionary, numbers differences."""
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "log.parquet"
    export(path, captures, columns=None, where=None)
    file = parquet.ParquetFile(path)
    said = {key.decode(): value.decode() for key, value in file.schema_arrow.metadata.items()}
    assert (said["modlens.table"], said["modlens.schema_version"]) == ("transactions", "2")
    chunks = [file.metadata.row_group(0).column(at) for at in range(file.metadata.num_columns)]
    coded = {one.path_in_schema for one in chunks if "RLE_DICTIONARY" in one.encodings}
    assert {"status", "unit", "function_name"} <= coded
    assert coded.isdisjoint({"request_hex", "txn", "source", "data.list.item"})
    differences = {one.path_in_schema for one in chunks if "DELTA_BINARY_PACKED" in one.encodings}
    assert {"txn", "time", "data.list.item"} <= differences
    assert {one.compression for one in chunks} == {"ZSTD"}
    assert str(file.schema_arrow.field("time").type) == "timestamp[ns, tz=UTC]"


def test_a_style_has_to_be_known() -> None:
    """A style that no output has is refused."""
    targets = [parse_target("a.jsonl", "frames"), parse_target("a.pcapng", "transactions")]
    check_style("rtu", targets)
    with pytest.raises(UsageError, match="--style rtu: none of these outputs has styles"):
        check_style("rtu", targets[:1])
    with pytest.raises(UsageError, match="--style json: choose from original, rtu, tcp, udp"):
        check_style("json", targets)
