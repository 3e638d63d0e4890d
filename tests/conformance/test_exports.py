"""Every export in the registry writes all four tables, whole, and so that others can read them."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import decode
from analyzer.columns import TABLES, columns
from analyzer.exports import FORMATS, load
from analyzer.exports.sink import ExportSink, target
from tests.conftest import CAPTURES

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


READERS: dict[str, Callable[[bytes], Rows]] = {"csv": from_csv, "jsonl": from_jsonl}


def expected(row: _modlens.Row) -> dict[str, str]:
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
    assert set(READERS) == set(FORMATS)


@pytest.mark.parametrize("recording", RECORDINGS)
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("name", FORMATS)
def test_an_export_has_every_row_and_cell(
    name: str, table: str, recording: str, tmp_path: Path
) -> None:
    """The same rows as the API gives, and only the columns of columns.toml, in order."""
    source = decode(CAPTURES / recording / "recording.jsonl", line="19200-8E1")
    path = tmp_path / f"out.{name}"
    sink = ExportSink(target(str(path), table), columns=None, where=None, growing=False)
    for batch in source.batches(table):
        sink.put(batch)
    sink.close()
    kinds = {column.key: column.type for column in columns(table)}
    found = READERS[name](path.read_bytes())
    wanted = [expected(row) for row in getattr(source, table)]
    assert len(found) == len(wanted) == sink.rows
    for row, other in zip(found, wanted, strict=True):
        assert list(row) == [key for key in kinds if key in row]
        assert set(row) == set(other)
        for key, value in row.items():
            assert same(key, kinds[key], value, other[key]), (key, value, other[key])


@pytest.mark.parametrize("name", FORMATS)
def test_a_growing_export_is_the_same_bytes(name: str, tmp_path: Path) -> None:
    """A live file is written in pieces; nothing shows of them."""
    source = decode(CAPTURES / RECORDINGS[0] / "recording.jsonl", line="19200-8E1")
    paths = [tmp_path / f"whole.{name}", tmp_path / f"growing.{name}"]
    for path in paths:
        growing = path is paths[1]
        sink = ExportSink(target(str(path), "frames"), columns=None, where=None, growing=growing)
        for batch in source.batches("frames"):
            sink.put(batch)
        sink.close()
    assert paths[0].read_bytes() == paths[1].read_bytes()


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_is_deterministic(name: str) -> None:
    """The same rows give the same bytes, with columns in any order asked for."""
    rows = decode(CAPTURES / RECORDINGS[1] / "recording.jsonl").frames
    keys = [column.key for column in reversed(columns("frames"))]
    once, again = (b"".join(map(load(name)(keys).rows, rows.tables())) for _ in range(2))
    assert once == again
