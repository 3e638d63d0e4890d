"""Eight small programs of people who work with data, as they would write them.

They were written before the API was, and say what it has to be like.
"""

from __future__ import annotations

import io
from collections import Counter
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pyarrow.parquet as pq

import modlens
from tests.conftest import CAPTURES

PLANT = CAPTURES / "pymodbus_plant" / "recording.jsonl"
DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
TCP = CAPTURES / "pymodbus_tcp" / "recording.pcap"


def test_how_much_of_each_unit_is_answered() -> None:
    """Counting in plain Python, with typed rows."""
    answered: Counter[int] = Counter()
    asked: Counter[int] = Counter()
    for transaction in modlens.decode(DISTURBED, line="19200-8E1"):
        asked[transaction.unit] += 1
        answered[transaction.unit] += transaction.status == "ok"
    assert asked.total() == 35
    assert answered.total() == 24


def test_response_times_in_polars() -> None:
    """Only the columns that are needed go to polars."""
    recording = modlens.decode(DISTURBED, line="19200-8E1")
    times = recording.transactions.where("ok").select("unit", "response_time_us").to_polars()
    assert isinstance(times, pl.DataFrame)
    assert times.columns == ["unit", "response_time_us"]
    slowest = times.group_by("unit").agg(pl.col("response_time_us").max())
    assert slowest.height == times["unit"].n_unique()


def test_a_series_of_a_register_in_pandas() -> None:
    """One register over time, as pandas plots it."""
    readings = modlens.decode(PLANT, line="19200-8E1").readings
    frame = readings.where("unit == 9 and address == 3223").to_pandas()
    assert isinstance(frame, pd.DataFrame)
    series = frame.set_index("time")["value"]
    assert series.index.is_monotonic_increasing
    assert len(series) > 0


def test_a_look_at_what_there_is() -> None:
    """Length, the first rows, the last one, a slice in the middle: as of a list."""
    transactions = modlens.decode(DISTURBED, line="19200-8E1").transactions
    assert len(transactions) == 35
    assert [row.txn for row in transactions.head(3)] == [1, 2, 3]
    assert transactions[-1].txn == 35
    assert [row.txn for row in transactions[10:13]] == [11, 12, 13]
    html = transactions.head()._repr_html_()
    assert html.count("<tr>") == 1 + 10
    assert "no_response" in transactions.where("no_response")._repr_html_()


def test_bytes_that_came_from_a_database() -> None:
    """No file anywhere: bytes, an open file in memory, and a file that somebody has opened."""
    data = PLANT.read_bytes()
    expected = [row.request_hex for row in modlens.decode(PLANT)]
    assert expected
    assert [row.request_hex for row in modlens.decode(data)] == expected
    assert [row.request_hex for row in modlens.decode(io.BytesIO(data))] == expected
    with PLANT.open("rb") as file:
        assert [row.request_hex for row in modlens.decode(file)] == expected


def test_a_folder_of_recordings_becomes_one_parquet_file(tmp_path: Path) -> None:
    """Several recordings, one table, the format by the name's ending."""
    recording = modlens.decode([PLANT, DISTURBED])
    written = recording.write(tmp_path / "all.parquet")
    table = pq.read_table(tmp_path / "all.parquet")
    assert table.num_rows == written == len(recording.transactions)
    assert set(table.column("bus").to_pylist()) == {str(PLANT), str(DISTURBED)}


def test_the_failures_go_to_wireshark_and_to_a_ticket(tmp_path: Path) -> None:
    """What a filter keeps is written, in two formats."""
    failures = modlens.decode(TCP).transactions.where("status != 'ok'")
    count = len(failures)
    assert count
    assert failures.write(tmp_path / "failures.csv") == count
    assert failures.write(tmp_path / "failures.pcapng") == count
    assert len((tmp_path / "failures.csv").read_text(encoding="utf-8").splitlines()) == 1 + count
    assert len(modlens.decode(tmp_path / "failures.pcapng").transactions) == count


def test_sql_over_a_recording() -> None:
    """Duckdb takes the stream of a table."""
    transactions = modlens.decode(DISTURBED).transactions
    database = duckdb.connect()
    database.register("polls", transactions.select("unit", "status").to_arrow())
    found = database.sql("select status, count(*) from polls group by status").fetchall()
    assert dict(found) == Counter(row.status for row in transactions)
