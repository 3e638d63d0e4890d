"""InfluxDB line protocol in Telegraf's names, read back by a parser of the protocol's grammar."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from analyzer import decode
from tests.conftest import CAPTURES, Modlens

FILE = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
LINE = re.compile(
    r"(?P<head>(?:\\.|[^ \\])+) (?P<fields>(?:\\.|\"(?:\\.|[^\"])*\"|[^ \\\"])+) (?P<ns>-?\d+)"
)


def parts(text: str) -> dict[str, str]:
    """`a=b,c=d` with escapes taken away."""
    found = {}
    for pair in re.split(r"(?<!\\),", text):
        key, value = re.split(r"(?<!\\)=", pair)
        found[re.sub(r"\\(.)", r"\1", key)] = re.sub(r"\\(.)", r"\1", value)
    return found


def parsed(path: Path) -> list[tuple[str, dict[str, str], dict[str, str], int]]:
    """Measurement, tags, fields and time of each line."""
    rows = []
    for line in path.read_text().splitlines():
        match = LINE.fullmatch(line)
        assert match, line
        measurement, _, tags = match["head"].partition(",")
        rows.append((measurement, parts(tags), parts(match["fields"]), int(match["ns"])))
    return rows


def test_readings_are_telegrafs_measurement(tmp_path: Path, modlens: Modlens) -> None:
    """Tags name, slave_id and type; a field a register; the frame's time in nanoseconds."""
    path = tmp_path / "bus.lp"
    assert modlens("export", FILE, "--line", "19200-8E1", "-o", f"readings:{path}").status == 0
    found = {}
    for measurement, tags, values, ns in parsed(path):
        assert measurement == "modbus"
        assert tags["name"] == tags["bus"] == str(FILE)
        for key, value in values.items():
            found[ns // 1000, int(tags["slave_id"]), tags["type"], key] = float(value)
    wanted = {
        (
            round(row.time.timestamp() * 1e6),
            row.unit,
            row.register_type,
            f"address_{row.address}",
        ): row.value
        for row in decode(FILE, line="19200-8E1").readings
        if row.status == "ok"
    }
    assert found == wanted


def test_transactions_are_a_measurement_of_their_own(tmp_path: Path, modlens: Modlens) -> None:
    """Response time and length, by bus, unit, function and status."""
    path = tmp_path / "bus.influx"
    assert modlens("export", FILE, "--line", "19200-8E1", "-o", path).status == 0
    rows = list(decode(FILE, line="19200-8E1").transactions)
    for (measurement, tags, values, _), row in zip(parsed(path), rows, strict=True):
        assert measurement == "modbus_transaction"
        assert (tags["slave_id"], tags["function"], tags["status"]) == (
            str(row.unit), str(row.function), row.status,
        )  # fmt: skip
        assert values["length"] == f"{len(row.request_hex) + len(row.response_hex)}i"
        told = values.get("response_time_us")
        assert (None if told is None else float(told)) == row.response_time_us


def test_rows_without_a_time_are_counted(tmp_path: Path, modlens: Modlens) -> None:
    """A database of times would file them under now."""
    path = tmp_path / "bus.lp"
    done = modlens("decode", "captures/seed_rtu/recording.hex", FILE, "-o", path)
    assert done.status == 0
    assert "rows without date and time skipped" in done.err
    assert parsed(path)


@pytest.mark.parametrize("command", ["decode", "export"])
@pytest.mark.parametrize("table", ["transactions", "readings"])
def test_without_any_utc_time_there_is_an_error(
    command: str, table: str, tmp_path: Path, modlens: Modlens
) -> None:
    """One sentence with the way out, no empty file, and an older file stays."""
    path, old = tmp_path / "bus.lp", tmp_path / "old.lp"
    old.write_bytes(b"old")
    source = "captures/seed_rtu/recording.hex"
    done = modlens(command, source, "-o", f"{table}:{path}", "-o", f"{table}:{old}")
    assert done.status == 3
    sentence = f"modlens: {path}: no row has a UTC time, which line protocol needs; --timezone and"
    assert done.err.count(sentence) == 1
    assert "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == [old]
    assert old.read_bytes() == b"old"


def test_to_standard_output_the_error_is_the_same(modlens: Modlens) -> None:
    """Nothing on standard output, status 3."""
    done = modlens("export", "captures/seed_rtu/recording.hex", "--to", "influx")
    assert (done.status, done.out) == (3, "")
    assert "standard output: no row has a UTC time" in done.err
