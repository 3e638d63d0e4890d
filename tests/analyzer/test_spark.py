"""Spark gives the rows of one file after the other, also where a worker dies and in a stream.

By default on an archive of 27 files; `make spark` takes the one of 203 files and 20 buses.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

pytest.importorskip("pyspark")

from analyzer.batches import decode_batches, schema
from analyzer.columns import TABLES, columns
from tests.conftest import ROOT, need_program
from tests.support.fleet import archive
from tests.support.spark_run import ROW_BYTES, chunks

FULL = "MODLENS_SPARK" in os.environ
BUSES, SHIFTS = (20, 10) if FULL else (8, 3)
LATER = ("bus-04", "bus-07")
"""Buses, a folder of logs and one of captures, that come while the stream is already there."""

QUICK_JAVA = "-XX:TieredStopAtLevel=1 -XX:+UseSerialGC"
"""Half of the time of a short job is that of Java's second compiler."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what Spark has made of an archive."""
    need_program("java")
    folder = tmp_path_factory.mktemp("spark")
    archive(folder / "archive", buses=BUSES, shifts=SHIFTS)
    shutil.copytree(folder / "archive", folder / "whole")
    for bus in LATER:
        (folder / "later" / bus).parent.mkdir(exist_ok=True)
        shutil.move(folder / "archive" / bus, folder / "later" / bus)
    (folder / "out").mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.spark_run"]
        + [str(folder / name) for name in ("archive", "later", "out")],
        cwd=ROOT,
        env={
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "SPARK_LOCAL_IP": "127.0.0.1",
            "JDK_JAVA_OPTIONS": QUICK_JAVA,
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    (folder / "seconds.json").write_text(done.stdout.splitlines()[-1])
    return folder


def spark_rows(folder: Path) -> Counter[str]:
    """The rows of Parquet files, with the times that they had before Spark cut them."""
    rows: Counter[str] = Counter()
    for path in folder.glob("date=*/*.parquet"):
        for row in pq.ParquetFile(path).read().to_pylist():
            day = path.parent.name.removeprefix("date=")
            assert day == ("unknown" if row["time"] is None else f"{row['time']:%Y-%m-%d}")
            time_ns = row.pop("time_ns")
            assert (row["time"] is None) == (time_ns is None)
            rows[str({**row, "time": time_ns})] += 1
    return rows


def rows_of(pieces: list[dict[str, Any]]) -> Counter[str]:
    """The rows that `decode_batches` gives in this process."""
    found = decode_batches(
        [pa.RecordBatch.from_pylist([piece]) for piece in pieces], notify=lambda _: None
    )
    table = pa.Table.from_batches(found, schema("transactions"))
    at = table.schema.get_field_index("time")
    table = table.set_column(at, "time", table.column("time").cast(pa.int64()))
    return Counter(map(str, table.to_pylist()))


def files_of(place: Path, folder: str, *buses: str) -> list[dict[str, Any]]:
    """The files of a folder as blocks, called as Spark found them."""
    return [
        {"bus": path.parent.name, "offset": 0, "bytes": path.read_bytes()}
        | {"path": str(place / "archive" / path.parent.name / path.name)}
        for path in sorted((place / folder).rglob("*"))
        if path.is_file() and (not buses or path.parent.name in buses)
    ]


def test_an_archive_gives_the_rows_of_one_file_after_the_other(place: Path) -> None:
    begun = {bus.name for bus in (place / "whole").iterdir()} - {*LATER}
    expected = rows_of(files_of(place, "whole", *begun))
    assert expected.total() > (BUSES - len(LATER)) * SHIFTS * 40
    assert spark_rows(place / "out/files") == expected


def test_large_files_are_read_where_they_lie(place: Path) -> None:
    large = {
        str(place / "archive" / path.relative_to(place / "whole"))
        for path in (place / "whole").rglob("*")
        if path.is_file() and path.parent.name not in LATER and path.stat().st_size > ROW_BYTES
    }
    assert len(large) >= SHIFTS
    assert {*json.loads((place / "out/in_place.json").read_text())} == large


def test_files_are_sorted_by_bus_and_time(place: Path) -> None:
    for path in (place / "out/files").glob("date=*/*.parquet"):
        table = pq.ParquetFile(path).read(["bus", "time_ns", "txn"])
        keys = [(row["bus"], row["time_ns"] or 0, row["txn"]) for row in table.to_pylist()]
        assert keys == sorted(keys)


def test_a_worker_that_is_killed_leaves_nothing_out_and_nothing_twice(place: Path) -> None:
    assert "cut.jsonl.gz" in (place / "out/killed.txt").read_text(), "it was not killed"
    files = files_of(place, "whole", "bus-00")
    assert len(files) == SHIFTS + 3
    unnamed = [{key: one[key] for key in ("path", "offset", "bytes")} for one in files]
    assert spark_rows(place / "out/killed") == rows_of(unnamed)


def test_bytes_off_lines_are_decoded_bus_by_bus_whatever_their_order(place: Path) -> None:
    pieces = [
        {"bus": bus, "offset": offset, "time": now, "bytes": data}
        for bus, offset, now, data in sorted(chunks())
    ]
    assert spark_rows(place / "out/lines") == rows_of(pieces)


def test_a_stream_takes_each_recording_once(place: Path) -> None:
    assert spark_rows(place / "out/stream") == rows_of(files_of(place, "whole"))


@pytest.mark.parametrize("table", TABLES)
def test_every_table_has_a_schema_in_spark(table: str) -> None:
    from analyzer.spark import spark_schema  # noqa: PLC0415

    names = spark_schema(table).fieldNames()
    own = [column.key for column in columns(table)]
    assert [name for name in names if name in own] == own
    assert all(name.removesuffix("_ns") in own for name in names)


def test_how_long_it_takes_is_known(place: Path) -> None:
    seconds = json.loads((place / "seconds.json").read_text())
    assert list(seconds) == ["begin", "started", "files", "lines", "stream"]
