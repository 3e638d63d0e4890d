"""Every export in the registry writes all four tables, whole, and so that others can read them."""

from __future__ import annotations

import csv
import io
import json
import os
import sqlite3
import sys
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from analyzer import SourceError, decode
from analyzer.columns import TABLES, columns
from analyzer.exports import FORMATS, ExportOptions, load
from analyzer.exports.sink import ExportSink, parse_target
from analyzer.row_types import AnyRow
from tests.conftest import CAPTURES, ROOT

RECORDINGS = ("pymodbus_all_functions", "pymodbus_disturbed", "pymodbus_exceptions")

Rows = list[dict[str, str]]


def from_csv(data: bytes) -> Rows:
    """Empty cells are null."""
    rows = csv.DictReader(io.StringIO(data.decode("utf-8"), newline=""))
    return [{key: value for key, value in row.items() if value} for row in rows]


def from_jsonl(data: bytes) -> Rows:
    """Values in the words of CSV; empty lists and texts are nothing there."""
    rows = [json.loads(line) for line in data.decode("utf-8").splitlines()]
    plain = [{key: as_text(value) for key, value in row.items()} for row in rows]
    return [{key: value for key, value in row.items() if value} for row in plain]


def as_text(value: Any) -> str:
    """A value of JSON as CSV spells it."""
    if isinstance(value, list):
        return " ".join(map(as_text, value))
    if isinstance(value, dict):
        return json.dumps(value, separators=(",", ":"), ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)


def from_arrow(data: bytes) -> Rows:
    """Types are those of columns.toml: text stays text, numbers are numbers."""
    ipc = pytest.importorskip("pyarrow.ipc")
    return plain(ipc.open_file(io.BytesIO(data)).read_all())


def from_parquet(data: bytes) -> Rows:
    """As pyarrow reads it."""
    parquet = pytest.importorskip("pyarrow.parquet")
    return plain(parquet.read_table(io.BytesIO(data)))


def plain(table: Any) -> Rows:
    """An Arrow table in the words of CSV."""
    pyarrow = pytest.importorskip("pyarrow")
    columns = {}
    for field, column in zip(table.schema, table.columns, strict=True):
        values = column
        if pyarrow.types.is_timestamp(field.type):
            assert field.type == pyarrow.timestamp("ns", tz="UTC")
            values = [None if one is None else iso(one) for one in column.cast("int64").to_pylist()]
        else:
            values = column.to_pylist()
        columns[field.name] = values
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    texts = [{key: "" if one is None else as_text(one) for key, one in row.items()} for row in rows]
    return [{key: value for key, value in row.items() if value} for row in texts]


def iso(ns: int) -> str:
    """Nanoseconds since 1970 as a time that `datetime` reads back."""
    return datetime.fromtimestamp(ns / 1e9, tz=UTC).isoformat()


def from_sqlite(data: bytes, table: str) -> Rows:
    """One of the four tables of a database."""
    base = sqlite3.connect(":memory:")
    # A database in memory has no write-ahead log: the header says so.
    base.deserialize(data[:18] + b"\1\1" + data[20:])
    found = base.execute(f"SELECT * FROM {table} ORDER BY rowid")
    keys = [one[0] for one in found.description]
    kinds = {column.key: column.type for column in columns(table)}
    rows = []
    for row in found:
        cells = zip(keys, row, strict=True)
        there = {key: value for key, value in cells if value is not None and value != ""}
        rows.append(
            {
                key: flag(value) if kinds[key] == "bool" else as_text(value)
                for key, value in there.items()
            }
        )
    base.close()
    return rows


def flag(value: int) -> str:
    """SQLite has no truth values."""
    return "true" if value else "false"


READERS: dict[str, Callable[[bytes], Rows]] = {
    "csv": from_csv,
    "jsonl": from_jsonl,
    "parquet": from_parquet,
    "arrow": from_arrow,
}

ELSEWHERE = {
    "sqlite": "test_sqlite.py",
    "xlsx": "test_xlsx.py",
    "pcapng": "test_wireshark.py",
    "pcap": "test_wireshark.py",
    "md": "test_paste.py",
    "txt": "test_paste.py",
    "zeek": "test_zeek.py",
    "icsnpp": "test_zeek.py",
    "influx": "test_influx.py",
    "simulator": "test_simulator.py",
}
"""Formats that do not hold every cell of every table, and the tests of what they hold."""


def expected(row: AnyRow) -> dict[str, str]:
    """A row as the API gives it, in the words of CSV, without what is empty."""
    found = {}
    for key, value in row.as_dict().items():
        if isinstance(value, bytes):
            text = value.hex()
        elif isinstance(value, datetime):
            text = value.isoformat()
        else:
            text = "" if value is None else as_text(value)
        if text:
            found[key] = text
    return found


def same(key: str, kind: str, one: str, other: str) -> bool:
    """Whether two cells say the same; times to the microsecond, which is what Python's have."""
    if kind in ("us", "float"):
        return float(one) == pytest.approx(float(other))
    if kind == "time":
        return (
            abs((datetime.fromisoformat(one) - datetime.fromisoformat(other)).total_seconds())
            < 2e-6
        )
    if kind == "map":
        return bool(json.loads(one) == json.loads(other))
    return one == other


def test_each_format_has_a_reader_here() -> None:
    """A further export brings its reader to this test."""
    assert set(READERS) | set(ELSEWHERE) == set(FORMATS)
    folder = ROOT / "tests" / "analyzer" / "exports"
    assert all((folder / file).exists() for file in ELSEWHERE.values())


@pytest.mark.parametrize("recording", RECORDINGS)
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("name", [*READERS, "sqlite"])
def test_an_export_has_every_row_and_cell(
    name: str, table: str, recording: str, tmp_path: Path
) -> None:
    """The same rows as the API gives, and only the columns of columns.toml, in order."""
    source = decode(CAPTURES / recording / "recording.jsonl", line="19200-8E1")
    path = tmp_path / f"out.{name}"
    sink = ExportSink(parse_target(str(path), table), columns=None, where=None, growing=False)
    for batch in source.batches(*TABLES):
        sink.put(batch)
    sink.close()
    kinds = {column.key: column.type for column in columns(table)}
    data = path.read_bytes()
    found = from_sqlite(data, table) if name == "sqlite" else READERS[name](data)
    wanted = [expected(row) for row in getattr(source, table)]
    assert len(found) == len(wanted) == sink.row_count
    for row, other in zip(found, wanted, strict=True):
        assert list(row) == [key for key in kinds if key in row]
        assert set(row) == set(other)
        for key, value in row.items():
            assert same(key, kinds[key], value, other[key]), (key, value, other[key])


def written(name: str, path: Path, *, growing: bool) -> bytes:
    """A recording in that format."""
    source = decode(CAPTURES / RECORDINGS[0] / "recording.jsonl", line="19200-8E1")
    sink = ExportSink(
        parse_target(str(path), TABLE_OF.get(name, "frames")),
        columns=None,
        where=None,
        growing=growing,
    )
    for batch in source.batches(*TABLES):
        sink.put(batch)
    sink.close()
    return path.read_bytes()


TABLE_OF = {name: load(name).tables[-1] for name in FORMATS if "frames" not in load(name).tables}


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in ("sqlite", "pcapng")])
def test_a_growing_export_is_the_same_bytes(name: str, tmp_path: Path) -> None:
    """A live file is written in blocks; nothing shows of them.

    (A database has pages that depend on commits; a live capture does not wait for what is found on
    a pair.)
    """
    whole = written(name, tmp_path / f"whole.{name}", growing=False)
    assert written(name, tmp_path / f"growing.{name}", growing=True) == whole != b""


@pytest.mark.parametrize("name", FORMATS)
def test_a_live_export_never_replaces_a_file(name: str, tmp_path: Path) -> None:
    """A live export never replaces a file, in any format."""
    path = tmp_path / f"out.{name}"
    path.write_bytes(b"precious")
    with pytest.raises(SourceError, match="never overwrites; choose another name"):
        written(name, path, growing=True)
    assert path.read_bytes() == b"precious"


@pytest.mark.parametrize("name", FORMATS)
def test_an_abandoned_export_leaves_nothing(name: str, tmp_path: Path) -> None:
    """A discarded export leaves no file under any name."""
    source = decode(CAPTURES / RECORDINGS[0] / "recording.jsonl", line="19200-8E1")
    one = parse_target(str(tmp_path / f"out.{name}"), TABLE_OF.get(name, "frames"))
    sink = ExportSink(one, columns=None, where=None, growing=False)
    for batch in source.batches(*TABLES):
        sink.put(batch)
    sink.rollback()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="named pipes of POSIX")
@pytest.mark.parametrize("name", FORMATS)
def test_a_pipe_is_written_into_and_never_replaced(name: str, tmp_path: Path) -> None:
    """Nor is a device: `-o` may be a link to `/dev/null`. A database cannot be a pipe."""
    pipe, got = tmp_path / f"pipe.{name}", list[bytes]()
    os.mkfifo(pipe)
    one = parse_target(str(pipe), TABLE_OF.get(name, "frames"))
    if name == "sqlite":
        with pytest.raises(SourceError, match="is not a regular file"):
            ExportSink(one, columns=None, where=None, growing=False)
    else:
        reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
        reader.start()
        sink = ExportSink(one, columns=None, where=None, growing=False)
        source = decode(CAPTURES / RECORDINGS[0] / "recording.jsonl", line="19200-8E1")
        for batch in source.batches(*TABLES):
            sink.put(batch)
        sink.close()
        reader.join()
        assert got == [written(name, tmp_path / f"file.{name}", growing=False)]
    assert pipe.is_fifo()


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "sqlite"])
def test_a_format_is_deterministic(name: str, tmp_path: Path) -> None:
    """The same rows give the same bytes: no clock, no order of a hash."""
    once, again = (written(name, tmp_path / f"{i}.{name}", growing=False) for i in range(2))
    assert once == again


@pytest.mark.parametrize("name", READERS)
def test_columns_come_in_the_order_asked_for(name: str) -> None:
    """Columns come in the given order."""
    keys = tuple(column.key for column in reversed(columns("frames")))
    form = load(name)(ExportOptions("frames", keys))
    rows = decode(CAPTURES / RECORDINGS[1] / "recording.jsonl").frames
    data = b"".join(map(form.encode, rows.tables())) + form.footer()
    found = READERS[name](data)
    assert [list(row) for row in found] == [[key for key in keys if key in row] for row in found]


@pytest.mark.parametrize("name", READERS)
def test_rows_of_several_buses_and_connections_keep_their_names(name: str, tmp_path: Path) -> None:
    """What all rows of a bus share is written for each of them, however they are mixed."""
    names = ("pymodbus_two_units/recording.jsonl", "pymodbus_tcp/recording.pcap")
    source = decode([CAPTURES / name for name in names])
    keys = ("bus", "frame", "client", "server", "connection", "source")
    path = tmp_path / f"out.{name}"
    sink = ExportSink(
        parse_target(str(path), "frames"), columns=",".join(keys), where=None, growing=False
    )
    for batch in source.batches(*TABLES):
        sink.put(batch)
    sink.close()
    rows = [expected(row) for row in source.frames]
    wanted = [{key: row[key] for key in keys if key in row} for row in rows]
    assert READERS[name](path.read_bytes()) == wanted
    assert len({(row["bus"], row.get("connection")) for row in wanted}) == 2
