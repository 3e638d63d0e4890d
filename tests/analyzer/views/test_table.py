"""The annotated tables: what is in a line, and that it fits."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest

from analyzer import decode
from analyzer.columns import TABLES
from analyzer.views.row_lines import TableOptions
from analyzer.views.screen import Screen
from analyzer.views.table_sink import TableSink
from tests.conftest import recording_with


def shown(  # noqa: PLR0913 - a table can look in so many ways
    path: Path, monkeypatch: pytest.MonkeyPatch, *, table: str = "transactions", width: int = 80,
    table_options: TableOptions | None = None, where: str | None = None,
    settings: str | None = "19200-8E1", profile: str | None = None,
) -> list[str]:  # fmt: skip
    """The lines of a recording's table."""
    monkeypatch.setenv("COLUMNS", str(width))
    profiles = [] if profile is None else [f"1={profile}"]
    stream = io.StringIO()
    sink = TableSink(table, Screen(stream), table_options or TableOptions(times="utc"), where=where)
    for batch in decode(path, line=settings, profiles=profiles).batches(table):
        sink.put(batch)
    return stream.getvalue().splitlines()


POLLS = "pymodbus_two_units"


@pytest.fixture
def polls(captures: Path) -> Path:
    """Polls of two units, with a UTC clock."""
    return captures / POLLS / "recording.jsonl"


def test_a_transaction_takes_a_line(polls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Number, time, unit, function, addresses, response time, status, values."""
    head, day, first, *_ = shown(polls, monkeypatch)
    assert head.split() == [
        "no.", "time", "UTC", "unit", "function", "addr", "from", "0", "resp.", "ms",
        "status,", "values",
    ]  # fmt: skip
    assert day == "2026-11-21"
    words = first.split()
    assert words[0] == "1"
    assert words[1].startswith("11:13:10.")
    assert words[2:7] == ["1", "3", "read", "hr", "0-9"]
    assert words[8:12] == ["ok", "42", "217", "65516"]
    assert "… +" in first


@pytest.mark.parametrize("width", [80, 100, 132, 200])
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize(
    "name", ["pymodbus_all_functions", "pymodbus_disturbed", "pymodbus_exceptions"]
)
def test_lines_fit_the_terminal(
    name: str, table: str, width: int, captures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At any width, in any table, whatever happened on the line."""
    path = captures / name / "recording.jsonl"
    path = recording_with(table) if table == "connections" else path
    lines = shown(path, monkeypatch, table=table, width=width)
    # A line on which nothing is wrong has no diagnosis.
    assert len(lines) > 1 or (table == "diagnoses" and not len(decode(path).diagnoses))
    assert max(map(len, lines), default=0) <= width


@pytest.mark.parametrize(
    ("base", "title", "first"),
    [
        ("wire", "addr from 0", "0-9"),
        ("hex", "hex from 0", "0x0000-0x0009"),
        ("5digit", "40001-based", "40001-40010"),
        ("6digit", "400001-based", "400001-400010"),
    ],
)
def test_the_head_names_the_base_of_addresses(
    base: str, title: str, first: str, polls: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The title of the address column names the notation of its addresses."""
    head, _, line, *_ = shown(polls, monkeypatch, table_options=TableOptions(base, "utc"))
    assert title in head
    assert f" {first} " in line


@pytest.mark.parametrize(
    ("times", "title", "second"),
    [
        ("utc", "time UTC", "11:13:10."),
        ("elapsed", "elapsed s", "0.03"),
        ("delta", "delta s", "0.03"),
    ],
)
def test_times_can_be_shown_in_ways(
    times: str, title: str, second: str, polls: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Time of day, since the start, since the row before."""
    head, *lines = shown(polls, monkeypatch, table_options=TableOptions(times=times))
    assert title in head
    rows = [line for line in lines if not line.startswith("2026")]
    assert rows[1].split()[1].startswith(second)


def test_local_time_names_its_zone(polls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The date changes where it changes for the reader."""
    monkeypatch.setenv("TZ", "Etc/GMT-14")
    time.tzset()
    try:
        head, day, line, *_ = shown(polls, monkeypatch, table_options=TableOptions(times="local"))
    finally:
        monkeypatch.undo()
        time.tzset()
    assert "time +14:00" in head
    assert day == "2026-11-22"
    assert " 01:13:10." in line


@pytest.mark.parametrize(("width", "shown_as"), [(80, "11:59:59.999"), (132, "11:59:59.999999")])
def test_a_clock_is_cut_not_rounded(
    width: int, shown_as: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A time of day never shows what has not come yet."""
    path = tmp_path / "bus.jsonl"
    path.write_text('{"t": 1697025599.9999999, "hex": "010300000001840a"}\n')
    _, day, line = shown(path, monkeypatch, width=width, settings=None)
    assert day == "2023-10-11"
    assert line.split()[1] == shown_as


@pytest.mark.parametrize("table", ["transactions", "readings"])
def test_names_and_labels_move_no_cursor(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A profile is text from outside as well: what hides in it is spelled out."""
    profile = tmp_path / "p.toml"
    label = "on\\u001b[2J\\u00ad\\u202e"
    profile.write_text(
        'profile = 1\n[[registers]]\nat = "hr:0"\nname = "mode"\ntype = "u16"\n'
        f'enum = {{7 = "{label}"}}\n'
    )
    path = tmp_path / "bus.hex"
    path.write_text("010300000001840a\n0103020007f986\n")
    text = "".join(shown(path, monkeypatch, table=table, width=200, profile=str(profile)))
    assert "on\\x1b[2J\\xad\\u202e" in text
    assert text.isprintable()


def test_what_is_no_block_of_registers_is_shown_field_by_field(
    captures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the recording has it (application protocol, 6.7, 6.8, 6.18)."""
    path = captures / "pymodbus_all_functions" / "recording.jsonl"
    text = "\n".join(shown(path, monkeypatch, width=160))
    for words in ("Read Exception Status", "Diagnostics", "Read FIFO Queue"):
        assert words in text
    assert "status=95" in text
    assert "sub_function=11" in text
    assert "fifo=[0 1 2" in text


def test_without_a_clock_the_place_in_the_file_stands_there(
    captures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line of text or an offset of bytes, and no response times."""
    head, first, *_ = shown(captures / "seed_rtu" / "recording.hex", monkeypatch)
    assert head.split()[:3] == ["no.", "line", "unit"]
    assert " ms " not in head
    assert first.split()[1] == "4"
    head, first, *_ = shown(captures / "seed_ascii" / "recording.bin", monkeypatch)
    assert head.split()[1] == "offset"


def test_a_filter_leaves_rows_out(polls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A filter leaves rows out; the others keep their numbers."""
    lines = shown(
        polls, monkeypatch, where="unit == 2", table_options=TableOptions(times="elapsed")
    )
    assert {line.split()[2] for line in lines[1:]} == {"2"}


def test_several_buses_have_a_column_of_their_own(
    captures: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The part of the path that distinguishes them, from the first line on."""
    names = []
    for day in ("monday", "tuesday"):
        path = tmp_path / day / "bus.hex"
        path.parent.mkdir()
        path.write_bytes((captures / "seed_rtu" / "recording.hex").read_bytes())
        names.append(str(path))
    monkeypatch.setenv("COLUMNS", "80")
    stream = io.StringIO()
    sink = TableSink("transactions", Screen(stream), TableOptions(buses=tuple(names)))
    for batch in decode(names).batches("transactions"):
        sink.put(batch)
    head, *lines = stream.getvalue().splitlines()
    assert head.split()[2] == "bus"
    assert [line.split()[2] for line in lines] == ["monday"] * 26 + ["tuesday"] * 26
    assert max(map(len, lines)) <= 80


def test_memory_stays_flat() -> None:
    """A table keeps no row: only its widths and the time of the last one."""
    sink = TableSink("frames", Screen(io.StringIO()), TableOptions())
    kept = {name for name in vars(sink) if "row" in name}
    assert kept == {"row_count"}
    assert isinstance(sink.row_count, int)
