"""Two hundred filters that people type, and what each answers: rows, or what to write instead."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from analyzer import FilterError, decode, filters
from tests.conftest import CAPTURES, ROOT

Rows = Callable[[Any], object]

READING = (1, 2, 3, 4, 20, 23, 24)
WRITING = (5, 6, 15, 16, 21, 22, 23)
"""Functions that read or write registers, bits, files or the FIFO queue (V1.1b3, section 6)."""

RECORDING = str(CAPTURES / "pymodbus_disturbed" / "recording.jsonl")

SELECTED: list[tuple[str, str, Rows]] = [
    # Words alone
    ("transactions", "exception", lambda row: row.exception is not None),
    ("transactions", "not exception", lambda row: row.exception is None),
    ("transactions", "retry", lambda row: "retry" in row.findings),
    ("transactions", "not retry", lambda row: "retry" not in row.findings),
    ("transactions", "no_response", lambda row: row.status == "no_response"),
    ("transactions", "not no_response", lambda row: row.status != "no_response"),
    ("transactions", "bad_response", lambda row: row.status == "bad_response"),
    ("transactions", "bad_checksum", lambda row: "bad_checksum" in row.findings),
    ("transactions", "ok", lambda row: row.status == "ok"),
    ("transactions", "not ok", lambda row: row.status != "ok"),
    ("transactions", "broadcast", lambda row: row.status == "broadcast"),
    ("transactions", "not_seen", lambda row: row.status == "not_observed"),
    ("transactions", "glitch", lambda row: "stray_bytes" in row.findings),
    ("transactions", "findings", lambda row: row.findings),
    ("transactions", "not findings", lambda row: not row.findings),
    ("transactions", "write", lambda row: row.function in WRITING),
    ("transactions", "read", lambda row: row.function in READING),
    ("transactions", "coil", lambda row: row.register_type == "coil"),
    ("transactions", "rtu", lambda row: row.mode == "rtu"),
    ("transactions", "tcp", lambda row: row.mode == "tcp"),
    ("transactions", "data", lambda row: row.data is not None),
    ("transactions", "write_data", lambda row: row.write_data is not None),
    ("transactions", "write_address", lambda row: row.write_address is not None),
    ("transactions", "retry_of", lambda row: row.retry_of is not None),
    ("transactions", "response_time_us", lambda row: row.response_time_us is not None),
    ("transactions", "waited_us", lambda row: row.waited_us is not None),
    ("transactions", "response_hex", lambda row: row.response_hex is not None),
    ("transactions", "retry or exception", lambda row: "retry" in row.findings or row.exception),
    (
        "transactions", "no_response and not retry",
        lambda row: row.status == "no_response" and "retry" not in row.findings,
    ),
    ("transactions", "retry and ok", lambda row: "retry" in row.findings and row.status == "ok"),
    (
        "transactions", "(retry or no_response) and write",
        lambda row: ("retry" in row.findings or row.status == "no_response")
        and row.function in WRITING,
    ),
    ("frames", "ok", lambda row: row.verdict == "ok"),
    ("frames", "not ok", lambda row: row.verdict != "ok"),
    ("frames", "noise", lambda row: row.verdict == "noise"),
    ("frames", "bad_checksum", lambda row: row.verdict == "bad_checksum"),
    ("frames", "incomplete", lambda row: row.verdict == "incomplete"),
    ("frames", "request", lambda row: row.direction == "request"),
    ("frames", "response and not ok",
     lambda row: row.direction == "response" and row.verdict != "ok"),
    ("frames", "unconfirmed", lambda row: row.unconfirmed),
    ("frames", "tentative", lambda row: row.unconfirmed),
    ("frames", "txn", lambda row: row.txn is not None),
    ("frames", "not txn", lambda row: row.txn is None),
    ("frames", "bit_flip", lambda row: "bit_flip" in row.findings),
    ("findings", "retry", lambda row: row.code == "retry"),
    ("findings", "error", lambda row: row.severity == "error"),
    ("findings", "warning or info", lambda row: row.severity in ("warning", "info")),
    ("findings", "no_response", lambda row: row.code == "no_response"),
    ("findings", "txn", lambda row: row.txn is not None),
    ("readings", "write", lambda row: row.operation == "write"),
    ("readings", "value", lambda row: row.value is not None),
    ("readings", "name", lambda row: row.name is not None),
    ("readings", "holding_register", lambda row: row.register_type == "holding_register"),
    # Comparisons
    ("transactions", "unit == 1", lambda row: row.unit == 1),
    ("transactions", "unit==1", lambda row: row.unit == 1),
    ("transactions", "(unit == 1)", lambda row: row.unit == 1),
    ("transactions", "unit != 1", lambda row: row.unit != 1),
    ("transactions", "unit == 0x01", lambda row: row.unit == 1),
    ("transactions", "unit in (1, 2)", lambda row: row.unit in (1, 2)),
    ("transactions", "unit in [1, 2]", lambda row: row.unit in (1, 2)),
    ("transactions", "1 <= unit <= 5", lambda row: 1 <= row.unit <= 5),
    ("transactions", "function == 3", lambda row: row.function == 3),
    ("transactions", "function in (3, 4)", lambda row: row.function in (3, 4)),
    ("transactions", "function not in (3, 4)", lambda row: row.function not in (3, 4)),
    ("transactions", "function == 6 and unit == 1", lambda row: row.function == 6),
    ("transactions", "not (function == 6)", lambda row: row.function != 6),
    ("transactions", "not function == 6", lambda row: row.function != 6),
    ("transactions", "function == 3 or function == 4", lambda row: row.function in (3, 4)),
    ("transactions", "function_name == 'Read Coils'",
     lambda row: row.function_name == "Read Coils"),
    ("transactions", "'Read' in function_name", lambda row: "Read" in row.function_name),
    ("transactions", "'Read' not in function_name", lambda row: "Read" not in row.function_name),
    ("transactions", "status == 'ok'", lambda row: row.status == "ok"),
    ("transactions", 'status == "ok"', lambda row: row.status == "ok"),
    ("transactions", "status != 'ok'", lambda row: row.status != "ok"),
    ("transactions", "status == 'no_response'", lambda row: row.status == "no_response"),
    ("transactions", "'no_response' == status", lambda row: row.status == "no_response"),
    (
        "transactions", "status in ('no_response', 'bad_response')",
        lambda row: row.status in ("no_response", "bad_response"),
    ),
    ("transactions", "'bad' in status", lambda row: "bad" in row.status),
    ("transactions", "'retry' in findings", lambda row: "retry" in row.findings),
    ("transactions", "'retry' not in findings", lambda row: "retry" not in row.findings),
    ("transactions", "not 'retry' in findings", lambda row: "retry" not in row.findings),
    ("transactions", "exception == 2", lambda row: row.exception == 2),
    ("transactions", "exception is None", lambda row: row.exception is None),
    ("transactions", "exception is not None", lambda row: row.exception is not None),
    ("transactions", "address == 100", lambda row: row.address == 100),
    ("transactions", "address == 0x64", lambda row: row.address == 100),
    ("transactions", "address >= 50 and address < 200",
     lambda row: row.address is not None and 50 <= row.address < 200),
    (
        "transactions", "address == '30101'",
        lambda row: row.address == 100 and row.register_type == "input_register",
    ),
    (
        "transactions", "address == '40001'",
        lambda row: row.address == 0 and row.register_type == "holding_register",
    ),
    ("transactions", "address == '4x0000'",
     lambda row: row.address == 0 and row.register_type == "holding_register"),
    ("transactions", "touches(hr, 6)", lambda row: touches(row, "holding_register", 6)),
    ("transactions", "touches(ir, 105)", lambda row: touches(row, "input_register", 105)),
    ("transactions", "touches(ir, '30106')", lambda row: touches(row, "input_register", 105)),
    ("transactions", "writes(hr, 6)", lambda row: row.write_address == 6),
    ("transactions", "writes(hr, range(0, 10))", lambda row: row.write_address == 6),
    ("transactions", "quantity > 5", lambda row: (row.quantity or 0) > 5),
    ("transactions", "1400 in write_data", lambda row: 1400 in (row.write_data or ())),
    ("transactions", "42 in data", lambda row: 42 in (row.data or ())),
    ("transactions", "response_time_us > 10000", lambda row: (row.response_time_us or 0) > 10_000),
    ("transactions", "response_time_us > 10e3", lambda row: (row.response_time_us or 0) > 10_000),
    ("transactions", "response_time_us / 1000 > 10",
     lambda row: (row.response_time_us or 0) > 10_000),
    ("transactions", "txn > 30", lambda row: row.txn > 30),
    ("transactions", "txn == 5", lambda row: row.txn == 5),
    ("transactions", "register_type == 'coil'", lambda row: row.register_type == "coil"),
    ("transactions", "operation == 'write'", lambda row: row.operation == "write"),
    ("transactions", "mode == 'rtu'", lambda row: row.mode == "rtu"),
    ("transactions", "'0103' in request_hex", lambda row: b"\1\3" in (row.request_hex or b"")),
    ("transactions", "time > '2026-11-21'", lambda row: True),
    ("transactions", "time < '2026-11-21 11:00'", lambda row: False),
    ("transactions", "unit == 1  and\tok", lambda row: row.status == "ok"),
    ("frames", "verdict == 'ok'", lambda row: row.verdict == "ok"),
    ("frames", "verdict != 'ok'", lambda row: row.verdict != "ok"),
    ("frames", "verdict in ('noise', 'incomplete')",
     lambda row: row.verdict in ("noise", "incomplete")),
    ("frames", "direction == 'request'", lambda row: row.direction == "request"),
    ("frames", "byte_length > 8", lambda row: row.byte_length > 8),
    ("findings", "code == 'retry'", lambda row: row.code == "retry"),
    ("findings", "severity == 'error'", lambda row: row.severity == "error"),
    ("readings", "address == 0", lambda row: row.address == 0),
    ("readings", "value > 1000", lambda row: (row.value or 0) > 1000),
]  # fmt: skip

TOLD: list[tuple[str, str, str]] = [
    # Operators of other languages
    ("transactions", "unit = 1", "write `==` to compare, not `=` (column 6"),
    ("transactions", "unit=1", "write `==`"),
    ("transactions", "unit === 1", "write `==`, not `===`"),
    ("transactions", "unit == 1 && function == 3", "write `and`, not `&&` (column 11"),
    ("transactions", "unit == 1 || unit == 2", "write `or`, not `||`"),
    ("transactions", "unit == 1 AND function == 3", "write `and`, not `AND`"),
    ("transactions", "unit == 1 And function == 3", "write `and`, not `And`"),
    ("transactions", "unit == 1 OR unit == 2", "write `or`, not `OR`"),
    ("transactions", "NOT exception", "write `not`, not `NOT` (column 1"),
    ("transactions", "!exception", "write `not`, not `!`"),
    ("transactions", "unit <> 1", "write `!=`, not `<>`"),
    ("transactions", "unit ≠ 1", "write `!=`, not `≠`"),
    ("transactions", "unit => 1", "write `>=`, not `=>`"),
    ("transactions", "unit =< 1", "write `<=`, not `=<`"),
    ("transactions", "unit eq 1", "write `==`, not `eq`"),
    ("transactions", "unit IN (1, 2)", "write `in`, not `IN`"),
    ("transactions", "exception IS NOT NULL", "`is None` or `is not None`"),
    ("transactions", "exception is not null", "`is None` or `is not None`"),
    ("transactions", "exception == null", "`is None` or `is not None`"),
    ("transactions", "exception != None", "`is None` or `is not None`"),
    ("transactions", "unit == 1 & function == 3", "join conditions by `and`"),
    ("transactions", "(unit == 1) & (function == 3)", "join conditions by `and`"),
    ("transactions", "unit == 1 | unit == 2", "join conditions by `or`"),
    ("transactions", "(unit == 1) | (unit == 2)", "join conditions by `or`"),
    ("transactions", "unit == 1, function == 3", "not by commas"),
    ("transactions", "unit == 1; function == 3", "write `and` or `or`"),
    ("transactions", "unit in 1, 2", "as in `unit in (1, 2)`"),
    ("transactions", "unit in 1-5", "`1 <= unit <= 5`"),
    ("transactions", "unit in range(1, 5)", "`1 <= unit < 5`"),
    ("transactions", "unit == 1 or 2", "`unit in (1, 2)`"),
    ("transactions", "status == 'ok' or 'exception'", "`status in ('ok', 'exception')`"),
    ("transactions", "unit BETWEEN 1 AND 5", "`1 <= unit <= 5`"),
    ("transactions", "function_name contains 'Read'", "`'text' in function_name`"),
    ("transactions", "function_name LIKE 'Read%'", "`'text' in function_name`"),
    ("transactions", "function_name =~ 'Read'", "`'text' in function_name`"),
    ("transactions", "function_name.startswith('Read')", "`'Read' in function_name`"),
    ("transactions", "modbus.func_code == 3", "write `function`"),
    ("transactions", "data[0] == 5", "`5 in data`"),
    ("transactions", "len(data) > 3", "`quantity > 3`"),
    # Quotes
    ("transactions", "status == ok", "in quotes: write 'ok'"),
    ("transactions", "status != ok", "in quotes: write 'ok'"),
    ("transactions", "status == exception", "in quotes: write 'exception'"),
    ("transactions", "status == no_respons", "in quotes: write 'no_response'"),
    ("transactions", "status == timeout", "in quotes: write 'no_response'"),
    ("frames", "verdict == ok", "in quotes: write 'ok'"),
    ("frames", "verdict == bad_crc", "in quotes: write 'bad_checksum'"),
    ("frames", "direction == request", "in quotes: write 'request'"),
    ("transactions", "mode == rtu", "in quotes: write 'rtu'"),
    ("transactions", "operation == write", "in quotes: write 'write'"),
    ("transactions", "bus == ttyUSB0", "in quotes: write 'ttyUSB0'"),
    ("transactions", "bus == /dev/ttyUSB0", "in quotes"),
    ("transactions", "status == “ok”", "straight quotes"),
    ("transactions", "retry in findings", "write `'retry' in findings`"),
    ("transactions", "'retry'", "`'retry' in findings`"),
    ("transactions", "time > 12:00", "in quotes"),
    ("transactions", "time > 2023-10-11", "in quotes"),
    ("transactions", "request_hex == 01 03", "as '01 03'"),
    ("transactions", "unit == '1'", "write 1 without quotes"),
    ("transactions", "function == 'Read Coils'", "names are in function_name"),
    ("transactions", "function == read_coils", "`'Read Coils' in function_name`"),
    ("transactions", "exception == illegal_data_address", "in exception_name"),
    (
        "transactions",
        "response_time_us > 50ms",
        "without a unit; 50ms is 50000, because _us columns",
    ),
    # Values of closed sets
    ("transactions", "status == 'no_respons'", "did you mean 'no_response'?"),
    ("transactions", "status == 'timeout'", "did you mean 'no_response'?"),
    ("transactions", "status == 'OK'", "did you mean 'ok'?"),
    ("transactions", "status == 'error'", "did you mean 'exception'?"),
    ("transactions", "status in ('ok', 'no_respons')", "(column 18 of"),
    ("transactions", "'purple' in status", "its values are ok, exception, no_response"),
    ("transactions", "status == 'purple'", "its values are ok, exception, no_response"),
    ("frames", "verdict == 'bad_crc'", "did you mean 'bad_checksum'?"),
    ("frames", "verdict == 'crc error'", "did you mean 'bad_checksum'?"),
    ("frames", "verdict == 'good'", "did you mean 'ok'?"),
    ("frames", "direction == 'req'", "did you mean 'request'?"),
    ("frames", "direction == 'resp'", "did you mean 'response'?"),
    ("frames", "direction == 'rx'", "did you mean 'response'?"),
    ("transactions", "mode == 'RTU'", "did you mean 'rtu'?"),
    ("transactions", "mode == 'Modbus/TCP'", "did you mean 'tcp'?"),
    ("transactions", "register_type == 'hr'", "did you mean 'holding_register'?"),
    ("transactions", "register_type == 'holding'", "did you mean 'holding_register'?"),
    ("transactions", "operation == 'writes'", "did you mean 'write'?"),
    ("transactions", "'retyr' in findings", "did you mean 'retry'?"),
    ("transactions", "'retries' in findings", "did you mean 'retry'?"),
    ("transactions", "'timeout' in findings", "did you mean 'no_response'?"),
    ("frames", "'crc' in findings", "did you mean 'bad_checksum'?"),
    ("findings", "code == 'late'", "did you mean 'late_response'?"),
    ("findings", "severity == 'warn'", "did you mean 'warning'?"),
    # Names of other programs
    ("transactions", "slave == 1", "write `unit`"),
    ("transactions", "slave_id == 1", "write `unit`"),
    ("transactions", "fc == 3", "write `function`"),
    ("transactions", "FC == 3", "write `function`"),
    ("transactions", "func == 3", "write `function`"),
    ("transactions", "crc", "`'bad_checksum' in findings`"),
    ("frames", "crc == 0", "`verdict == 'bad_checksum'`"),
    ("transactions", "value > 100", "`value` with --table readings"),
    ("transactions", "timeout", "`status == 'no_response'`"),
    ("frames", "timeout", "`'no_response' in findings`"),
    ("transactions", "reg == 5", "`touches(hr, 107)`"),
    ("transactions", "register == 5", "`touches(hr, 107)`"),
    ("transactions", "id == 1", "`unit`, `txn` or `mbap_id`"),
    ("frames", "src == '10.0.0.1'", "write `client`"),
    ("transactions", "dst == '10.0.0.1'", "write `server`"),
    ("transactions", "error", "`exception`, or `status != 'ok'`"),
    ("transactions", "code == 2", "`function` or `exception`"),
    ("transactions", "length > 8", "write `quantity`"),
    ("frames", "length > 8", "write `byte_length`"),
    ("transactions", "response_time > 5", "did you mean 'response_time_us'?"),
    ("transactions", "latency > 5", "write `response_time_us`"),
    ("transactions", "Unit == 1", "write `unit`"),
    ("transactions", "untis == 1", "did you mean 'unit'?"),
    ("transactions", "exeption", "did you mean 'exception'?"),
    ("transactions", "retyr", "did you mean 'retry'?"),
    ("transactions", "retry == 1", "write `'retry' in findings`"),
    ("transactions", "verdict == 'ok'", "`verdict` with --table frames"),
    ("frames", "address == 5", "`address` with --table transactions"),
    ("transactions", "unit", "as in `unit == 1`"),
    ("transactions", "status", "as in `status == "),
    ("transactions", "address == 400001", "'400001' in quotes, wire address 0"),
]


def test_write_and_read_alone_mean_every_function_that_does() -> None:
    """File records and read/write are among them, whose operations are `other` and `read_write`."""
    rows = decode(str(CAPTURES / "pymodbus_all_functions" / "recording.jsonl")).transactions
    assert {row.function for row in rows.where("write")} == set(WRITING)
    assert {row.function for row in rows.where("read")} == set(READING)


def touches(row: Any, kind: str, address: int) -> bool:
    """Whether a row reads or writes a register."""
    if row.register_type != kind:
        return False
    read = row.address is not None and row.address <= address < row.address + row.quantity
    return bool(read or row.write_address == address)


@cache
def recording() -> Any:
    return decode(RECORDING)


def test_there_are_two_hundred() -> None:
    assert len(SELECTED) + len(TOLD) >= 200
    assert len({(table, text) for table, text, _ in [*SELECTED, *TOLD]}) >= 200


@pytest.mark.parametrize(("table", "text", "expected"), SELECTED)
def test_it_selects(table: str, text: str, expected: Rows) -> None:
    """The rows that the words say, in the order of the table."""
    rows = getattr(recording(), table)
    wanted = [row.as_dict() for row in rows if expected(row)]
    assert [row.as_dict() for row in rows.where(text)] == wanted


@pytest.mark.parametrize(("table", "text", "expected"), TOLD)
def test_it_is_told(table: str, text: str, expected: str) -> None:
    """One line, with the words to write instead."""
    with pytest.raises(FilterError) as caught:
        filters.parse(text, table)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "noted"),
    [
        ("address == 40001", "'40001' in quotes, wire address 0"),
        ("address in (5, 40001)", "'40001' in quotes, wire address 0"),
        ("30001 <= write_address", "input register 30001"),
        ("touches(hr, 40108)", "wire address 107"),
        ("address == 0x9C41", ""),
        ("address == '40001'", ""),
        ("quantity == 40001", ""),
    ],
)
def test_a_number_of_a_manual_is_noted(text: str, noted: str) -> None:
    """It is valid, because wire addresses reach 65535; in hex it is surely meant."""
    notes = filters.parse(text).notes
    assert len(notes) == bool(noted)
    assert noted in "".join(notes)


def examples() -> Iterator[tuple[str, str, str]]:
    """Place, table and filter of every example of the help texts and the documents."""
    sources = [
        *(ROOT / "analyzer").rglob("*.py"),
        ROOT / "README.md",
        *(ROOT / "docs").rglob("*.md"),
    ]
    for path in sorted(sources):
        for line in path.read_text(encoding="utf-8").splitlines():
            if re.match(r"\s*modlens [a-z]", line) and re.search(r"--(where|stop-on)", line):
                words = shlex.split(line)
                table = words[words.index("--table") + 1] if "--table" in words else "transactions"
                for option, value in pairwise(words):
                    if option in ("--where", "--stop-on"):
                        yield str(path.relative_to(ROOT)), table, value


@pytest.mark.parametrize(("place", "table", "text"), list(examples()))
def test_the_examples_work(place: str, table: str, text: str) -> None:
    filters.parse(text, table).predicate()


def test_there_are_examples() -> None:
    """The search above finds what it is for."""
    places = {Path(place).name for place, _, _ in examples()}
    assert {"filters.md", "tap.py", "decode.py"} <= places
