"""The queries of docs/fleets.md give the answers that were put into the traffic."""

from __future__ import annotations

import shutil
import subprocess
import sys
from typing import Any

import duckdb
import pytest

import _modlens
from tests.conftest import ROOT
from tests.docs.documents import blocks
from tests.doctor.network import Network

PAGE = "docs/fleets.md"
_DAY = 1_795_132_800
"""2026-11-20T00:00:00Z."""


def framed(*adu: int) -> bytes:
    body = bytes(adu)
    return body + _modlens.crc16(body).to_bytes(2, "little")


def pumps(day: int) -> str:
    """A day: unit 1 answers 10 ms later each day, unit 2 has gone on the third; a write at six."""
    lines: list[tuple[float, bytes]] = []
    for number in range(200):
        unit, at = 1 + number % 2, _DAY + day * 86_400 + number * 400
        lines.append((at, framed(unit, 3, 0, 100, 0, 2)))
        if unit == 1 or day < 2:
            late = 0.010 * (day + 1) if unit == 1 else 0.015
            lines.append((at + late + 0.008, framed(unit, 3, 4, 0, day, 0, number)))
    write = framed(1, 6, 0, 40, 0, day)
    six = _DAY + day * 86_400 + 6 * 3600 + 100.0
    lines += [(six, write), (six + 0.03, write)]
    return "".join(f'{{"t": {at:.3f}, "hex": "{data.hex()}"}}\n' for at, data in sorted(lines))


def two_clients() -> bytes:
    """Two clients that ask one server in turn."""
    network = Network()
    flows = [network.flow(f"10.0.0.{host}", "10.0.9.2") for host in (1, 2)]
    for turn, flow in enumerate(flows):
        flow.open(turn * 0.1)
    for number in range(20):
        flow = flows[number % 2]
        head = number.to_bytes(2, "big") + b"\0\0"
        flow.send(1 + number, True, head + b"\0\6\1\3\0\0\0\1")
        flow.send(1.02 + number, False, head + b"\0\5\1\3\2\0\7")
    return network.pcap()


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> duckdb.DuckDBPyConnection:
    """The page's view over a folder that the page's command has made."""
    place = tmp_path_factory.mktemp("questions")
    for name in ("pumps", "tcp", "line"):
        (place / "archive" / name).mkdir(parents=True)
    for day in range(4):
        (place / "archive/pumps" / f"{day}.jsonl").write_text(pumps(day))
    (place / "archive/tcp/two.pcap").write_bytes(two_clients())
    shutil.copy(ROOT / "captures/pymodbus_two_masters/recording.jsonl", place / "archive/line")
    command = blocks(PAGE, "text")[0].text.split()
    assert command[:2] == ["modlens", "export"]
    subprocess.run(
        [sys.executable, "-m", "analyzer", *(word.strip("'") for word in command[1:])],
        cwd=place,
        check=True,
        capture_output=True,
    )
    wanted = [f"pumps,1,holding_register,{address}\n" for address in (99, 100, 101, 102)]
    (place / "wanted.csv").write_text("bus,unit,register_type,address\n" + "".join(wanted))
    connection = duckdb.connect()
    connection.execute(f"SET file_search_path = '{place}'; SET TimeZone = 'UTC'")
    connection.execute(blocks(PAGE, "sql")[0].text)
    return connection


def answer(database: duckdb.DuckDBPyConnection, number: int) -> list[tuple[Any, ...]]:
    """What a query of the page gives, counted after the view."""
    return database.execute(blocks(PAGE, "sql")[number].text).fetchall()


def test_the_page_has_the_view_and_five_questions() -> None:
    assert len(blocks(PAGE, "sql")) == 6


def test_rising_response_times(database: duckdb.DuckDBPyConnection) -> None:
    [(bus, unit, first, last, per_day)] = answer(database, 1)
    assert (bus, unit) == ("pumps", 1)
    assert last - first == pytest.approx(30_000, abs=2_000), "10 ms more on each of three days"
    assert per_day == pytest.approx(10_000, abs=1_000)


def test_registers_never_polled(database: duckdb.DuckDBPyConnection) -> None:
    assert [row[3] for row in answer(database, 2)] == [99, 102]


def test_writes_by_time_of_day(database: duckdb.DuckDBPyConnection) -> None:
    rows = [row for row in answer(database, 3) if row[1] == "pumps"]
    assert rows == [(6, "pumps", 1, 40, 4)]


def test_units_that_vanished(database: duckdb.DuckDBPyConnection) -> None:
    # As seconds: DuckDB gives times with a zone to Python by a package that is not needed else.
    query = blocks(PAGE, "sql")[4].text.rstrip().rstrip(";")
    rows = database.execute(f"SELECT * REPLACE (epoch(last_answer) AS last_answer) FROM ({query})")
    [(bus, unit, last, silences)] = [row for row in rows.fetchall() if row[0] == "pumps"]
    assert (bus, unit) == ("pumps", 2)
    assert last == pytest.approx(_DAY + 86_400 + 199 * 400, abs=1), "its last request of day two"
    assert 198 <= silences <= 200, "a hundred on each of two days; the ends cut some off"


def test_two_masters(database: duckdb.DuckDBPyConnection) -> None:
    found = {bus: (clients, collisions) for bus, clients, collisions in answer(database, 5)}
    assert found["10.0.9.2:502"] == (2, 0)
    [line] = [counts for bus, counts in found.items() if bus != "10.0.9.2:502"]
    assert line[1] > 0
    assert "pumps" not in found
