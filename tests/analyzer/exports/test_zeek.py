"""Zeek's logs: the fields of the real ones, in their order, and our rows in them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import _modlens
from analyzer import Decoding, decode
from analyzer.exports import ExportOptions
from analyzer.exports.sink import ExportSink, parse_target
from tests.conftest import CAPTURES

MODBUS = "ts uid id.orig_h id.orig_p id.resp_h id.resp_p tid unit func pdu_type exception".split()
DETAILED = (
    "ts uid id.orig_h id.orig_p id.resp_h id.resp_p tid unit func address quantity request_values"
    " response_values modbus_detailed_link_id matched request_subfunction_code"
    " response_subfunction_code request_data response_data exception_code mei_type"
).split()
"""As Zeek 8 and icsnpp-modbus (December 2025) write them."""


def recording(name: str = "pymodbus_all_functions") -> Decoding:
    """A recording."""
    return decode(CAPTURES / name / "recording.jsonl", line="19200-8E1")


def log(path: Path, name: str = "pymodbus_all_functions", style: str = "") -> list[dict[str, str]]:
    """The lines of a log, as a reader of Zeek's logs takes them: by the header."""
    one = parse_target(str(path), "transactions")
    sink = ExportSink(
        one, columns=None, where=None, growing=False, options=ExportOptions("", (), style=style)
    )
    for batch in recording(name).batches("transactions"):
        sink.put(batch)
    sink.close()
    lines = path.read_text().splitlines()
    fields = next(line for line in lines if line.startswith("#fields")).split("\t")[1:]
    types = next(line for line in lines if line.startswith("#types")).split("\t")[1:]
    assert len(fields) == len(types)
    rows = [line.split("\t") for line in lines if not line.startswith("#")]
    return [dict(zip(fields, row, strict=True)) for row in rows]


def test_modbus_log_has_a_line_a_pdu(tmp_path: Path) -> None:
    """Each PDU has a line, with requests and responses in Zeek's words."""
    rows = log(tmp_path / "modbus.log", "pymodbus_exceptions")
    assert list(rows[0]) == MODBUS
    transactions = list(recording("pymodbus_exceptions").transactions)
    asked = [row for row in rows if row["pdu_type"] == "REQ"]
    sent = [one for one in transactions if one.request_frame]
    assert [int(row["unit"]) for row in asked] == [one.unit for one in sent]
    assert [int(row["tid"]) for row in asked] == [one.txn for one in sent]
    refused = [row for row in rows if row["exception"] != "-"]
    assert len(refused) == sum(one.exception is not None for one in transactions)
    assert {row["func"] for row in refused} >= {"READ_HOLDING_REGISTERS_EXCEPTION"}
    assert {row["exception"] for row in refused} >= {
        "ILLEGAL_FUNCTION", "ILLEGAL_DATA_ADDRESS", "SLAVE_DEVICE_BUSY", "MEMORY_PARITY_ERROR",
    }  # fmt: skip
    assert {row["pdu_type"] for row in refused} == {"RESP"}
    first = transactions[0]
    assert abs(float(rows[0]["ts"]) - first.time.timestamp()) < 2e-6
    assert (rows[0]["id.resp_h"], rows[0]["id.resp_p"]) == (f"10.0.0.{first.unit}", "502")


def test_the_detailed_log_has_a_line_a_transaction(tmp_path: Path) -> None:
    """Addresses, quantities and values as icsnpp writes them."""
    rows = log(tmp_path / "modbus_detailed.log")
    assert list(rows[0]) == DETAILED
    transactions = list(recording().transactions)
    assert len(rows) == len(transactions)
    for row, one in zip(rows, transactions, strict=True):
        address = one.address if one.address is not None else one.write_address
        assert row["address"] == ("-" if address is None else str(address))
        for key, values in (("request_values", one.write_data), ("response_values", one.data)):
            assert row[key] == ("-" if values is None else ",".join(map(str, values)))
        assert row["matched"] == ("T" if one.status in ("ok", "exception") else "F")
    by_name = {row["func"]: row for row in rows}
    assert by_name["DIAGNOSTICS"]["request_subfunction_code"] != "-"
    assert by_name["ENCAP_INTERFACE_TRANSPORT"]["mei_type"] == "READ-DEVICE-IDENTIFICATION"


def test_bits_behind_the_quantity_stand_apart(tmp_path: Path) -> None:
    """Of a byte that answers one coil, seven bits are padding: icsnpp has them as data."""
    path = tmp_path / "bus.hex"
    bodies = [bytes.fromhex("010100010001"), bytes.fromhex("01010101")]
    frames = [body + _modlens.crc16(body).to_bytes(2, "little") for body in bodies]
    path.write_text("".join(f"{frame.hex()}\n" for frame in frames))
    one = parse_target(str(tmp_path / "modbus_detailed.log"), "transactions")
    sink = ExportSink(one, columns=None, where=None, growing=False)
    for batch in decode(path).batches("transactions"):
        sink.put(batch)
    sink.close()
    row = (tmp_path / "modbus_detailed.log").read_text().splitlines()[-1].split("\t")
    found = dict(zip(DETAILED, row, strict=True))
    assert (found["quantity"], found["response_values"]) == ("1", "1")
    assert found["response_data"] == "0,0,0,0,0,0,0"
    assert found["ts"] == "-"


@pytest.mark.parametrize(
    ("name", "fields"), [("modbus.log", MODBUS), ("modbus_detailed.log", DETAILED)]
)
def test_json_says_the_same(name: str, fields: list[str], tmp_path: Path) -> None:
    """An object a line; what is not set is left out."""
    one = parse_target(str(tmp_path / name), "transactions")
    sink = ExportSink(
        one, columns=None, where=None, growing=False, options=ExportOptions("", (), style="json")
    )
    for batch in recording().batches("transactions"):
        sink.put(batch)
    sink.close()
    objects = [json.loads(line) for line in (tmp_path / name).read_text().splitlines()]
    (tmp_path / "tsv").mkdir()
    rows = log(tmp_path / "tsv" / name)
    assert len(objects) == len(rows)
    for found, row in zip(objects, rows, strict=True):
        assert list(found) == [key for key in fields if row[key] != "-"]
        for key, value in found.items():
            text = ",".join(map(str, value)) if isinstance(value, list) else value
            text = {True: "T", False: "F"}[text] if isinstance(text, bool) else str(text)
            assert key == "ts" or text == row[key]
