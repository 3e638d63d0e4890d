"""Zeek's logs: the fields of the real ones, in their order, and our rows in them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
    """Addresses, quantities and values as icsnpp writes them.

    It pairs the functions that Zeek has events for; of the others each PDU has a line.
    """
    rows = log(tmp_path / "modbus_detailed.log")
    assert list(rows[0]) == DETAILED
    pending = iter(rows)
    for one in recording().transactions:
        row = next(pending)
        assert row["unit"] == str(one.unit)
        if one.function in (7, 11, 12, 17):
            assert (row["matched"], next(pending)["matched"]) == ("-", "-")
            continue
        assert row["matched"] == ("T" if one.status in ("ok", "exception") else "F")
        if one.function in (1, 2, 3, 4, 15, 16):
            address = one.address if one.address is not None else one.write_address
            assert row["address"] == str(address)
            for key, values in (("request_values", one.write_data), ("response_values", one.data)):
                assert row[key] == ("-" if values is None else ",".join(map(str, values)))
    assert next(pending, None) is None
    by_name = {row["func"]: row for row in rows}
    assert by_name["DIAGNOSTICS"]["request_subfunction_code"] != "-"
    assert by_name["ENCAP_INTERFACE_TRANSPORT"]["mei_type"] == "Read Device Identification"


EXCHANGES: Sequence[tuple[str, str, dict[str, str]]] = (
    ("04 01 0001 0001", "04 01 01 01", {
        "address": "1", "quantity": "1", "response_values": "1", "response_data": "0,0,0,0,0,0,0",
    }),
    ("05 02 0001 0008", "05 02 01 2c", {
        "address": "1", "quantity": "8", "response_values": "0,0,1,1,0,1,0,0",
    }),
    ("04 03 0001 0001", "04 03 02 00aa", {
        "address": "1", "quantity": "1", "response_values": "170",
    }),
    ("06 05 0001 ff00", "06 05 0001 ff00", {
        "address": "1", "quantity": "1", "request_values": "1", "response_values": "1",
    }),
    ("07 06 0001 abcd", "07 06 0001 abcd", {
        "address": "1", "quantity": "1", "request_values": "43981", "response_values": "43981",
    }),
    ("02 08 0002 0000", "02 08 0002 0000", {
        "request_subfunction_code": "Return Diagnostic Register",
        "response_subfunction_code": "Return Diagnostic Register",
        "request_data": "\\x00\\x00", "response_data": "\\x00\\x00",
    }),
    ("07 0f 0001 0004 01 09", "07 0f 0001 0004", {
        "address": "1", "quantity": "4", "request_values": "1,0,0,1",
    }),
    ("07 10 0001 0004 08 00aa 00bb 00cc 00dd", "07 10 0001 0004", {
        "address": "1", "quantity": "4", "request_values": "170,187,204,221",
    }),
    ("08 14 00", "08 14 00", {"quantity": "0"}),
    ("08 15 00", "08 15 00", {"quantity": "0"}),
    ("04 16 000a dead 0000", "04 16 000a dead 0000", {"address": "10"}),
    ("06 17 0001 0001 0002 0001 02 00ff", "06 17 02 00aa", {}),
    ("0a 18 0000", "0a 18 0002 0000", {"address": "0", "quantity": "0"}),
    ("01 2b 0e 01 00", "01 2b 0e 01 83 00 00 01 00 04 5a65656b", {
        "mei_type": "Read Device Identification",
    }),
    ("00 03 0258 000a", "00 83 02", {
        "address": "600", "quantity": "10", "exception_code": "ILLEGAL_DATA_ADDRESS",
    }),
)  # fmt: skip
"""Requests and responses of icsnpp-modbus' test capture, and the fields that its baseline has set.

Where the baseline is of an older version, which had sub-function, data, exception and MEI type in
two fields, they are in the fields that the present one has for them. Identifiers that lead to its
other logs are left out.
"""

RECORDS: Sequence[tuple[str, str, dict[str, str]]] = (
    # The examples of the specification, sections 6.14 and 6.15, and 6.18 for the queue.
    ("01 14 0e 06 0004 0001 0002 06 0003 0009 0002",
     "01 14 0c 05 06 0dfe 0020 05 06 33cd 0040", {
        "quantity": "2",
        "response_data": "[file_len=5, ref_type=6, record_data=\\x0d\\xfe\\x00 ]"
        " | [file_len=5, ref_type=6, record_data=3\\xcd\\x00@]",
    }),
    ("01 15 0d 06 0004 0007 0003 06af 04be 100d", "01 15 0d 06 0004 0007 0003 06af 04be 100d", {
        "quantity": "1",
        "response_data": "[ref_type=6, file_num=4, record_num=7, record_len=3,"
        " record_data=\\x06\\xaf\\x04\\xbe\\x10\\x0d]",
    }),
    ("01 18 04de", "01 18 0006 0002 01b8 1284", {
        "address": "1246", "quantity": "2", "response_values": "440,4740",
    }),
)  # fmt: skip
"""Of these the baseline has no values; the form is that of Zeek's records."""

CLIENT, SERVER = ("192.168.1.6", 37699), ("3.15.227.20", 1502)


def connection(path: Path, exchanges: Sequence[tuple[str, str, dict[str, str]]]) -> list[list[str]]:
    """Log the exchanges of a TCP connection; the lines after the header."""
    layers = pytest.importorskip("scapy.all")
    numbers, packets = [1000, 5000], list[Any]()
    for tid, (request, response, _) in enumerate(exchanges, 1):
        for side, text in enumerate((request, response)):
            adu = bytes.fromhex(text)
            message = tid.to_bytes(2, "big") + b"\0\0" + len(adu).to_bytes(2, "big") + adu
            (source, sport), (target, dport) = (CLIENT, SERVER) if side == 0 else (SERVER, CLIENT)
            tcp = layers.TCP(
                sport=sport, dport=dport, seq=numbers[side], ack=numbers[1 - side], flags="PA"
            )
            packet = layers.Ether() / layers.IP(src=source, dst=target) / tcp / message
            packet.time = 1_700_000_000 + len(packets) / 100
            packets.append(packet)
            numbers[side] += len(message)
    capture = path.with_suffix(".pcap")
    layers.wrpcap(str(capture), packets)
    one = parse_target(str(path), "transactions")
    sink = ExportSink(one, columns=None, where=None, growing=False)
    for batch in decode(capture, ports=[SERVER[1]]).batches("transactions"):
        sink.put(batch)
    sink.close()
    return [line.split("\t") for line in path.read_text().splitlines() if line[0] != "#"]


def test_the_detailed_log_is_that_of_icsnpp(tmp_path: Path) -> None:
    """Each line has the fields that icsnpp has in it, and no other."""
    exchanges = [*EXCHANGES, *RECORDS]
    lines = connection(tmp_path / "modbus_detailed.log", exchanges)
    assert len(lines) == len(exchanges)
    for tid, (line, (_, _, expected)) in enumerate(zip(lines, exchanges, strict=True), 1):
        found = {key: value for key, value in zip(DETAILED, line, strict=True) if value != "-"}
        assert (found["tid"], found.pop("matched")) == (str(tid), "T")
        assert {key: value for key, value in found.items() if key in DETAILED[9:]} == expected


def test_functions_that_icsnpp_does_not_pair_have_a_line_for_each_pdu(tmp_path: Path) -> None:
    """Functions 7 and 17 have two lines, and nothing but their names."""
    slow: Sequence[tuple[str, str, dict[str, str]]] = (
        ("02 07", "02 07 00", {}),
        ("02 11", "02 11 03 61 62 ff", {}),
        ("02 07", "02 87 04", {}),
    )
    lines = connection(tmp_path / "modbus_detailed.log", slow)
    names = [line[8] for line in lines]
    assert names == [
        "READ_EXCEPTION_STATUS", "READ_EXCEPTION_STATUS", "REPORT_SLAVE_ID", "REPORT_SLAVE_ID",
        "READ_EXCEPTION_STATUS", "READ_EXCEPTION_STATUS_EXCEPTION",
    ]  # fmt: skip
    assert [float(line[0]) for line in lines] == sorted(float(line[0]) for line in lines)
    for line in lines[:-1]:
        assert set(line[9:]) == {"-"}
    assert dict(zip(DETAILED, lines[-1], strict=True))["exception_code"] == "SLAVE_DEVICE_FAILURE"


@pytest.mark.parametrize("name", ["modbus.log", "modbus_detailed.log"])
def test_lines_of_a_connection_join_the_log_of_connections(name: str, tmp_path: Path) -> None:
    """Ends and ports are those of the capture, and each connection has a uid of its own."""
    lines = connection(tmp_path / name, EXCHANGES)
    ends = {tuple(line[2:6]) for line in lines}
    assert ends == {(CLIENT[0], str(CLIENT[1]), SERVER[0], str(SERVER[1]))}
    (uid,) = {line[1] for line in lines}
    assert uid[0] == "C"
    assert uid.isalnum()
    again = {line[1] for line in connection(tmp_path / name, EXCHANGES)}
    assert again == {uid}


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
