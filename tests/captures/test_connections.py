"""The table of TCP connections, in every export, with filters and in Python."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest

from analyzer import UsageError, decode
from analyzer.cli.between import combine_filters
from analyzer.row_types import ConnectionRow
from tests.conftest import CAPTURES, Modlens

FILE = CAPTURES / "pymodbus_tcp" / "recording.pcap"


def test_a_recorded_connection_is_told_whole() -> None:
    """One client that asked 22 times, was answered each time, and closed the connection.

    The frames are in frames.jsonl, as the two programs themselves have noted them.
    """
    text = (FILE.parent / "frames.jsonl").read_text(encoding="utf-8")
    frames = [json.loads(line) for line in text.splitlines()]
    asked = [frame for frame in frames if frame["direction"] == "request"]
    (row,) = decode(FILE).connections
    assert (row.connection, row.requests, row.answered) == (1, len(asked), len(frames) - len(asked))
    assert (row.client, row.server, row.bus) == ("127.0.0.1", "127.0.0.1:502", "127.0.0.1:502")
    assert (row.closed_by, row.refused, row.reset, row.lost_bytes) == ("client", False, False, 0)
    assert (row.client_framing, row.server_framing) == ("tcp", "tcp")
    assert (row.first_status, row.in_flight_max, row.lockstep, row.findings) == ("ok", 1, 0, [])
    assert row.opened < row.closed
    assert row.source == f"{FILE}#1"


def test_every_export_holds_the_same_row(tmp_path: Path, modlens: Modlens) -> None:
    """CSV, JSON lines, SQLite, Arrow and Parquet, each in one pass with the others."""
    names = {ending: tmp_path / f"c.{ending}" for ending in ("csv", "jsonl", "parquet", "arrow")}
    outputs = [word for path in names.values() for word in ("-o", f"connections:{path}")]
    base = tmp_path / "c.sqlite"
    assert modlens("export", FILE, *outputs, "-o", base).status == 0
    (row,) = decode(FILE).connections
    written = json.loads(names["jsonl"].read_text(encoding="utf-8"))
    assert (written["client_port"], written["requests"]) == (row.client_port, row.requests)
    assert "retransmitted_segments" in written
    head, line = names["csv"].read_text(encoding="utf-8").splitlines()
    assert dict(zip(head.split(","), line.split(","), strict=True))["closed_by"] == "client"
    with sqlite3.connect(base) as database:
        found = database.execute("SELECT connection, requests, refused FROM connections").fetchall()
    assert found == [(1, row.requests, 0)]
    tables = pytest.importorskip("pyarrow.parquet").read_table(names["parquet"]).to_pylist()
    assert [(one["connection"], one["idle_us"]) for one in tables] == [(1, row.idle_us)]
    arrow = pytest.importorskip("pyarrow.ipc").open_file(names["arrow"].read_bytes()).read_all()
    assert arrow.to_pylist() == tables


@pytest.mark.parametrize(
    ("where", "count"),
    [
        ("refused", 0), ("not refused", 1), ("closed_by == 'client'", 1), ("reset or refused", 0),
        ("requests == answered", 1), ("client_framing != server_framing", 0), ("ok", 1),
        ("idle_us > 10e6", 0), ("opened > '2020-01-01'", 1), ("closed is None", 0),
    ],
)  # fmt: skip
def test_connections_are_filtered(where: str, count: int, modlens: Modlens) -> None:
    """By `--where` and in Python alike."""
    assert len(decode(FILE).connections.where(where)) == count
    words = ["export", FILE, "--table", "connections", "--where", where, "--to", "jsonl"]
    assert len(modlens(*words).out.splitlines()) == count


def test_between_is_about_the_opening(modlens: Modlens) -> None:
    """`--between` compares the time of the opening, for connections have no seconds."""
    words = ["export", FILE, "--table", "connections", "--to", "csv", "--columns", "connection"]
    for times, count in ((("17:00:00Z", "18:00:00Z"), 1), (("18:00:00Z", "19:00:00Z"), 0)):
        clock = [time.removesuffix("Z") for time in times]
        assert len(modlens(*words, "--times", "utc", "--between", *clock).out.split()) == 1 + count
    with pytest.raises(UsageError, match="give two times"):
        combine_filters(None, ["0", "1"], table="connections")


def test_a_log_has_no_connections(modlens: Modlens) -> None:
    """Where the connection is not known, there is no row."""
    path = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
    assert list(decode(path).connections) == []
    assert modlens("export", path, "--table", "connections", "--to", "jsonl").out == ""


def test_the_screen_says_how_a_connection_ended(modlens: Modlens) -> None:
    """A line each: the client with its port, counts, the end."""
    shown = modlens("decode", FILE, "--table", "connections", "--times", "utc", COLUMNS="100").out
    head, _, line = shown.splitlines()
    assert head.split()[:2] == ["conn", "time"]
    (row,) = decode(FILE).connections
    assert f"127.0.0.1:{row.client_port}" in line
    assert "closed by client after" in line


def connections(name: str) -> list[ConnectionRow]:
    """The connections of a capture of real pymodbus clients and servers."""
    return list(decode(CAPTURES / name / "recording.pcap").connections)


def asked(name: str) -> int:
    """The requests that the clients themselves have noted."""
    text = (CAPTURES / name / "frames.jsonl").read_text(encoding="utf-8")
    return sum(json.loads(line)["direction"] == "request" for line in text.splitlines())


@pytest.mark.parametrize(
    "name",
    [
        "pymodbus_one_client_only", "pymodbus_idle_close", "pymodbus_connect_each_time",
        "pymodbus_lockstep",
    ],
)  # fmt: skip
def test_the_counts_are_those_of_the_transactions(name: str) -> None:
    """Requests, answers and the first outcome of each connection equal the transactions export."""
    transactions = list(decode(CAPTURES / name / "recording.pcap").transactions)
    rows = connections(name)
    assert sum(row.requests for row in rows) == asked(name)
    assert [row.opened for row in rows] == sorted(row.opened for row in rows)
    for row in rows:
        own = [one for one in transactions if one.connection == row.connection]
        sent = [one for one in own if one.request_frame is not None]
        assert row.requests == len(sent)
        assert row.answered == sum(one.status in ("ok", "exception") for one in sent)
        assert row.first_status == (sent[0].status if sent else None)


def test_a_server_with_one_place_resets_the_others() -> None:
    """Each attempt of another client is reset as long as one is served."""
    rows = connections("pymodbus_one_client_only")
    served = [row for row in rows if row.requests]
    turned_away = [row for row in rows if not row.requests]
    assert len(served) > 1
    assert turned_away
    for row in turned_away:
        assert (row.reset, row.closed_by, row.refused) == (True, "server", False)
        assert any(one.opened < row.opened < one.closed for one in served)
    assert not any(row.reset for row in served)


def test_a_server_that_closes_idle_connections_is_told_with_its_time() -> None:
    """After half a second of silence, as the server was reported."""
    rows = connections("pymodbus_idle_close")
    assert len(rows) > 1
    for row in rows:
        assert (row.closed_by, row.reset) == ("server", False)
        assert 500_000 <= row.idle_us < 600_000


def test_a_connection_for_each_request_carries_one() -> None:
    """The client closes it after the answer."""
    for row in connections("pymodbus_connect_each_time"):
        assert (row.requests, row.answered, row.closed_by) == (1, 1, "client")


def test_a_server_that_is_a_step_behind_is_counted() -> None:
    """From the eleventh request on, each is given the answer to the one before.

    The tenth got none. The answer that comes after the last request is followed by no further one.
    """
    (row,) = connections("pymodbus_lockstep")
    assert row.requests == asked("pymodbus_lockstep")
    assert row.requests - 12 <= row.lockstep <= row.requests - 10
    assert row.in_flight_max == 1
    assert all(one.lockstep == 0 for one in connections("pymodbus_tcp"))
