"""`decode_batches`: blocks of recordings and lines give the rows of whole files."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import pyarrow as pa
import pytest

from analyzer import decode
from analyzer.batches import BatchSettings, decode_batches, recording_of, running_numbers, schema
from analyzer.columns import TABLES
from analyzer.session import FileRun
from analyzer.settings import Settings
from dissectors.errors import SourceError, UsageError
from tests.support.fleet import DAMAGED, FORMATS, Traffic, archive

PIECES = pa.schema(
    [
        ("bus", pa.string()),
        ("path", pa.string()),
        ("offset", pa.int64()),
        ("time", pa.timestamp("ns", "UTC")),
        ("bytes", pa.binary()),
    ]
)

Piece = tuple[str | None, str | None, int, int | None, bytes]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """An archive of twenty buses by the names of its files."""
    folder = tmp_path_factory.mktemp("archive")
    return {str(path): path.read_bytes() for path in archive(folder)}


def batch(pieces: Sequence[Piece]) -> Any:
    return pa.record_batch([list(column) for column in zip(*pieces, strict=True)], schema=PIECES)


def decoded(batches: Sequence[Any], table: str, **settings: Any) -> Any:
    chosen = BatchSettings(table=table, **settings)
    found = decode_batches(batches, chosen, notify=lambda _: None)
    return pa.Table.from_batches(found, schema(table))


def one_after_the_other(recordings: dict[str, bytes], table: str) -> list[dict[str, Any]]:
    """The rows of each file by itself, as `modlens export FILE` gives them."""
    rows: list[dict[str, Any]] = []
    for name in sorted(recordings):
        try:
            tables = [pa.table(getattr(part, table)) for part in decode(name).batches(table)]
        except SourceError:
            continue
        rows += pa.concat_tables(tables).to_pylist()
    return rows


def by_recording(rows: list[dict[str, Any]], table: str) -> list[dict[str, Any]]:
    """In the order of one pass, whatever came first here."""
    number = {"frames": "frame", "transactions": "txn", "findings": "frame"}[table]
    return sorted(rows, key=lambda row: (recording_of(row["source"]), row[number] or 0, str(row)))


def random_pieces(recordings: dict[str, bytes], rng: Random) -> list[Piece]:
    """Every file cut at random places, blocks of all files mixed."""
    pieces: list[Piece] = []
    for name, data in recordings.items():
        cuts = sorted({0, len(data), *(rng.randrange(len(data) + 1) for _ in range(8))})
        pieces += [(None, name, start, None, data[start:end]) for start, end in pairwise(cuts)] or [
            (None, name, 0, None, b"")
        ]
    rng.shuffle(pieces)
    return pieces


@pytest.mark.parametrize("table", ["frames", "transactions", "findings"])
def test_files_cut_into_random_pieces_give_the_rows_of_whole_files(
    recordings: dict[str, bytes], table: str
) -> None:
    expected = one_after_the_other(recordings, table)
    pieces = random_pieces(recordings, Random(table))
    cut = [batch(pieces[start : start + 50]) for start in range(0, len(pieces), 50)]
    whole = [batch([(None, name, 0, None, data)]) for name, data in recordings.items()]
    assert len(recordings) == 203
    assert len(expected) > 200
    for batches in (whole, cut):
        found = decoded(batches, table).to_pylist()
        assert by_recording(found, table) == by_recording(expected, table)


def test_what_is_damaged_is_told_and_the_rest_is_decoded(recordings: dict[str, bytes]) -> None:
    told: list[str] = []
    whole = [batch([(None, name, 0, None, data)]) for name, data in recordings.items()]
    buses = {
        row
        for one in decode_batches(whole, notify=told.append)
        for row in set(one["bus"].to_pylist())
    }
    assert sorted(Path(text.split(":")[0]).name for text in told) == sorted(DAMAGED)
    assert any(bus.endswith("cut.jsonl.gz") for bus in buses), "what can be read of it is decoded"
    assert len(buses) == 15 * 10 + 5 + 1, "a file each, but captures, whose bus is the server"


def test_every_request_of_the_archive_is_a_transaction_of_its_bus(tmp_path: Path) -> None:
    """Counted from the generator, not from another decoding."""
    for form in FORMATS:
        data = Traffic(3, 1, 34).recording(form)
        rows = decoded([batch([("plant", f"a.{form}", 0, None, data)])], "transactions").to_pylist()
        silent = [row["status"] for row in rows if row["status"] != "ok"]
        assert len(rows) == 34
        assert len(silent) == 2, "every seventeenth request has no answer"
        assert {row["bus"] for row in rows} == {"10.0.3.2:502" if form == "pcap" else "plant"}


@pytest.mark.parametrize("settings", [{}, {"line": "19200-8E1"}])
def test_reads_off_a_line_give_the_rows_of_its_recording(settings: dict[str, Any]) -> None:
    """A chunk log has the same reads, so that a whole file is the second way to the rows."""
    traffic = Traffic(1, 0, 200)
    pieces: list[Piece] = []
    at = 0
    for now, data in traffic.reads():
        pieces.append(("pumps", None, at, now, data))
        at += len(data)
    expected = decoded(
        [batch([("pumps", "log.jsonl", 0, None, traffic.chunks())])], "transactions", **settings
    )
    rng = Random(5)
    starts = sorted(rng.sample(range(1, len(pieces)), 20))
    cut = [batch(pieces[a:b]) for a, b in zip([0, *starts], [*starts, None], strict=True)]
    twice = [part for one in cut for part in (one, one)]
    for batches in (cut, twice):
        found = decoded(batches, "transactions", **settings)
        same = [name for name in found.schema.names if name not in ("source", "elapsed_us")]
        assert found.select(same).to_pylist() == expected.select(same).to_pylist()


def test_bytes_of_a_line_may_be_cut_anywhere_and_begin_anywhere() -> None:
    data = Traffic(1, 0, 60).raw()
    start = len(data) // 3
    whole = decoded([batch([("b", None, 0, None, data)])], "frames")
    rng = Random(6)
    cuts = sorted({start, len(data), *(rng.randrange(start, len(data)) for _ in range(30))})
    pieces: list[Piece] = [("b", None, a, None, data[a:b]) for a, b in pairwise(cuts)]
    late = decoded([batch([piece]) for piece in pieces], "frames").to_pylist()
    key = ("bus", "line", "byte_offset", "byte_length", "direction", "hex")
    expected = {tuple(row[name] for name in key) for row in whole.to_pylist()}
    assert late[0]["byte_offset"] == start
    assert late[0]["source"] == f"b@{start}"
    # But for the frame that the beginning cuts off, the rows are those of the whole stream.
    assert [row for row in late[1:] if tuple(row[name] for name in key) not in expected] == []
    assert b"".join(bytes.fromhex(row["hex"]) for row in late) == data[start:]


def test_a_gap_in_a_line_is_a_gap_and_disorder_is_refused() -> None:
    data = Traffic(1, 0, 20).raw()
    apart: list[Piece] = [("b", None, 0, None, data[:100]), ("b", None, 130, None, data[130:])]
    rows = decoded([batch(apart)], "frames").to_pylist()
    # The frames are those of the stream, and nothing joins what stood on both sides of the gap.
    assert sum(row["byte_length"] for row in rows) == len(data) - 30
    assert not [
        row for row in rows if row["byte_offset"] < 100 < row["byte_offset"] + row["byte_length"]
    ]
    with pytest.raises(UsageError, match="sort the blocks of a bus by offset"):
        decoded([batch([*apart, ("b", None, 100, None, data[100:130])])], "frames")


def test_a_recording_with_a_missing_piece_is_told() -> None:
    data = Traffic(1, 0, 20).chunks()
    told: list[str] = []
    pieces = [batch([("b", "x.jsonl", 0, None, data[:50]), ("b", "x.jsonl", 60, None, data[60:])])]
    assert not list(decode_batches(pieces, notify=told.append))
    assert told == ["x.jsonl: bytes 50 to 60 have not come; not decoded"]


def test_a_path_without_bytes_is_read_where_it_lies(
    tmp_path: Path, recordings: dict[str, bytes]
) -> None:
    some = {name: data for name, data in recordings.items() if "/bus-0" in name}
    told: list[str] = []
    pieces: list[Any] = [(None, name, 0, None, None) for name in [*some, str(tmp_path / "gone")]]
    found = decode_batches([batch(pieces)], notify=told.append)
    table = pa.Table.from_batches(found, schema("transactions"))
    expected = one_after_the_other(some, "transactions")
    assert by_recording(table.to_pylist(), "transactions") == by_recording(expected, "transactions")
    assert len(told) == len(DAMAGED) + 1
    assert f"{tmp_path}/gone: " in told[-1]


def test_a_recording_whose_size_is_known_is_decoded_when_it_is_there() -> None:
    data = Traffic(1, 0, 20).chunks()
    pieces = pa.table(
        {
            "path": ["x.jsonl"] * 2,
            "offset": [70, 0],
            "bytes": [data[70:], data[:70]],
            "size": [len(data)] * 2,
        }
    )
    seen: list[int] = []

    def batches() -> Any:
        for one in pieces.to_batches(max_chunksize=1):
            yield one
            seen.append(len(rows))

    rows: list[Any] = []
    for found in decode_batches(batches()):
        rows.append(found)
    assert seen == [0, 1]


def test_numbers_run_on_as_in_one_pass(recordings: dict[str, bytes]) -> None:
    some = {name: data for name, data in recordings.items() if "/bus-0" in name}
    readable = {name: data for name, data in some.items() if Path(name).name not in DAMAGED}
    pieces = [batch([piece]) for piece in random_pieces(readable, Random(9))]
    counted = ("frames", "transactions", "findings", "connections")
    tables = {name: decoded(pieces, name) for name in counted}
    numbered = running_numbers(tables)
    run = FileRun(sorted(readable), Settings(tables=tuple(tables)))
    expected: dict[str, list[Any]] = {name: [] for name in tables}
    for part in run.batches():
        for name, rows in expected.items():
            rows.extend(pa.table(getattr(part, name)).to_pylist())
    for name, rows in expected.items():

        def key(row: dict[str, Any]) -> tuple[int, str]:
            own = {name: value for name, value in row.items() if name != "elapsed_us"}
            return row.get("frame") or row.get("txn") or row.get("connection") or 0, str(own)

        assert sorted(map(key, numbered[name].to_pylist())) == sorted(map(key, rows))
    with pytest.raises(UsageError, match="readings has no column source"):
        running_numbers({**tables, "readings": decoded(pieces, "readings")})


@pytest.mark.parametrize("table", TABLES)
def test_the_schema_is_that_of_the_rows(table: str) -> None:
    data = Traffic(3, 0, 40).pcap()
    for one in decode_batches(
        [batch([(None, "x.pcap", 0, None, data)])], BatchSettings(table=table)
    ):
        assert one.schema == schema(table)


def test_settings_are_checked_and_columns_asked_for() -> None:
    with pytest.raises(UsageError, match="no table 'rows'"):
        BatchSettings(table="rows")
    with pytest.raises(UsageError, match="needed are bus or path, offset, bytes"):
        list(decode_batches([pa.record_batch({"bus": ["a"], "data": [b""]})]))
