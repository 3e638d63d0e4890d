"""A capture that modlens has written is read back: the same rows but for where they stand.

What cannot be the same, and why:

- `source` names the packet of the capture, not the line of the recording.
- The order of findings of different frames: each comes with its packet.
- Findings on a connection (lost segments, segments sent twice) and on a line as a whole (a unit
  that pads its responses) belong to no frame, and so to no packet.
- Of a live tap: the end of a transaction that nothing follows. Its packets are written when it is
  open, and the file ends before its end is known.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import Decoding, decode
from analyzer.columns import columns
from analyzer.exports import ExportOptions
from analyzer.exports.recorder import RecordedPort, Recorder
from tests.analyzer.exports.test_wireshark import MIXED, export, frame, recording, styled
from tests.conftest import CAPTURES, need_program
from tests.support.tshark import environment

pyarrow = pytest.importorskip("pyarrow")
pytest.importorskip("pyarrow.compute")

TABLES = ("frames", "transactions", "findings", "readings")

RECORDINGS = sorted(CAPTURES.glob("*/recording.*"))


def rows(source: Decoding, table: str, skip: Iterable[str] = ("source",)) -> list[dict[str, Any]]:
    """The rows of a table without some columns; findings in the order of their frames."""
    listed: list[dict[str, Any]] = pyarrow.table(getattr(source, table)).to_pylist()
    found = [{key: row[key] for key in row if key not in skip} for row in listed]
    if table == "findings":
        found = [row for row in found if row["frame"] is not None]
        found.sort(key=lambda row: (row["frame"], row["code"], row["detail"]))
    return found


def assert_same(source: Decoding, path: Path, tables: Sequence[str] = TABLES) -> None:
    """The capture has the rows of the recording, and each of them."""
    back = decode(path)
    for table in tables:
        one, other = (_arrow(which, table) for which in (back, source))
        assert one.equals(other) or rows(back, table) == rows(source, table), table


def _arrow(source: Decoding, table: str) -> Any:
    """A table without places; findings in the order of their frames."""
    found = pyarrow.table(getattr(source, table))
    if "source" in found.column_names:
        found = found.drop_columns(["source"])
    if table == "findings":
        found = found.filter(pyarrow.compute.field("frame").is_valid())
        found = found.sort_by([(key, "ascending") for key in ("frame", "code", "detail")])
    return found.combine_chunks()


@pytest.mark.parametrize("style", ["udp", "rtu"])
def test_a_capture_has_the_rows_of_its_recording(style: str, tmp_path: Path) -> None:
    """Every recording of the project: RTU and ASCII, damaged frames and noise, one bus and several.

    With clocks and without, with line settings and without.
    """
    seen: set[str] = set()
    for path in RECORDINGS:
        for line in ("19200-8E1",) if style == "rtu" else (None, "19200-8E1"):
            source = decode(path, line=line)
            assert_same(source, export(source, tmp_path / f"{style}.pcapng", options=styled(style)))
            seen.update(row["verdict"] for row in rows(source, "frames"))
    assert seen == {"ok", "bad_checksum", "incomplete", "noise", "no_checksum"} - {"no_checksum"}
    assert_same(recording(*MIXED), export(recording(*MIXED), tmp_path / "many.pcapng"))


def test_a_bus_without_checksums_and_one_with_marked_bytes(tmp_path: Path) -> None:
    """Frames that a program prints without CRC; bytes that a receiver has marked; two lines."""
    printed = tmp_path / "printed.log"
    printed.write_text("TX: 01 03 00 00 00 01 --\nRX: 01 03 02 00 07 --\n" * 3)
    source = decode(printed, read_as="hex")
    assert {row["verdict"] for row in rows(source, "frames")} == {"no_checksum"}
    for style in ("udp", "rtu"):
        assert_same(source, export(source, tmp_path / "printed.pcapng", options=styled(style)))
    ports = [RecordedPort("two lines", letter, f"/dev/tty{letter}", "9600-8N1") for letter in "AB"]
    recorder = Recorder(str(tmp_path / "raw.pcapng"), ports)
    for number in range(4):
        for letter, data in (("A", frame(1, bytes([3, 0, 0, 0, 1]))), ("B", frame(1, b"\3\2\0\7"))):
            errors = (2,) if number == 2 else ()
            read = _Read(data, (1 + number) * 10**9 + 20_000_000 * (letter == "B"), errors)
            recorder.write_read("two lines", letter, read)
    recorder.close()
    source = decode(tmp_path / "raw.pcapng")
    assert {row["line"] for row in rows(source, "frames")} == {"A", "B"}
    assert {row["bus"] for row in rows(source, "frames")} == {"two lines"}
    details = [row["detail"] for row in rows(source, "findings") if row["code"] == "line_error"]
    assert details == [
        "the receiver reported errors in 1 of 8 bytes",
        "the receiver reported errors in 1 of 7 bytes",
    ]
    assert_same(source, export(source, tmp_path / "lines.pcapng"))


class _Read:
    def __init__(self, data: bytes, time_ns: int, errors: tuple[int, ...]) -> None:
        self.data, self.time_ns, self.errors, self.hole = data, time_ns, errors, False


def test_connections_of_a_network(tmp_path: Path) -> None:
    """Client, server and number of each connection; here serial traffic dressed as Modbus/TCP."""
    dressed = export(recording(*MIXED), tmp_path / "tcp.pcapng", options=styled("tcp"))
    source = decode(dressed)
    assert len({row["connection"] for row in rows(source, "frames")}) > 5
    assert all(row["client"] and row["server"] for row in rows(source, "transactions"))
    assert_same(source, export(source, tmp_path / "again.pcapng"))


def test_a_crc_may_begin_with_a_colon(tmp_path: Path) -> None:
    """As the text of an ASCII frame does. 0x3A is the low byte of this one's checksum."""
    data = next(
        whole
        for number in range(65536)
        if (whole := frame(1, bytes([6, 0, 1]) + number.to_bytes(2)))[-2] == ord(":")
    )
    path = tmp_path / "colon.bin"
    path.write_bytes(data * 2)
    source = decode(path, mode="rtu", read_as="raw")
    assert_same(source, export(source, tmp_path / "colon.pcapng"))
    back = decode(export(source, tmp_path / "colon.pcap"))
    assert [row.hex for row in back.frames] == [data, data]


@pytest.mark.parametrize("again", ["tshark", "editcap"])
def test_what_others_save_anew_is_read_back(again: str, tmp_path: Path) -> None:
    """Other programs keep our options and comments when they save a capture."""
    source = recording(*MIXED)
    path, copy = export(source, tmp_path / "one.pcapng"), tmp_path / "again.pcapng"
    words = ["-r", str(path), "-w", str(copy)] if again == "tshark" else [str(path), str(copy)]
    subprocess.run(
        [need_program(again), *words], check=True, timeout=60, capture_output=True,
        env=environment(tmp_path),
    )  # fmt: skip
    assert_same(source, copy)


def test_a_cut_keeps_the_numbers_and_verdicts(tmp_path: Path) -> None:
    """A retry keeps the number of the request it repeats, though the filter left that out."""
    source = recording("pymodbus_disturbed")
    where = "status != 'ok' or retry_of is not None"
    path = export(source, tmp_path / "cut.pcapng", where=where)
    wanted = [row for row in rows(source, "transactions") if _wanted(row)]
    assert rows(decode(path), "transactions") == wanted
    numbers = {row["txn"] for row in wanted}
    frames = [row for row in rows(source, "frames") if row["txn"] in numbers]
    assert rows(decode(path), "frames") == frames
    assert 5 < len(wanted) < 35


def _wanted(row: dict[str, Any]) -> bool:
    return row["status"] != "ok" or row["retry_of"] is not None


def test_a_growing_capture_of_a_tap(tmp_path: Path) -> None:
    """Frames are written as soon as they are final, their transactions later, but for the last."""
    path = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
    whole = decode(path, line="19200-8E1")
    growing = _modlens.Capture("udp", live=True)
    data = b""
    for batch in whole.batches("frames", "findings"):
        growing.put(batch)
        data += b"".join(iter(growing.more, b""))
    capture = tmp_path / "live.pcapng"
    capture.write_bytes(data + growing.end())
    told = {row["txn"]: row for row in rows(decode(capture), "transactions")}
    ended = {row["txn"]: row for row in rows(whole, "transactions")}
    assert told.keys() == ended.keys()
    assert rows(decode(capture), "frames") == rows(whole, "frames")


LESS = {
    "classic pcap": {
        "bus", "confidence", "unconfirmed", "gap_us", "delimited_by", "elapsed_us", "source",
        "findings", "byte_offset", "txn",
    },
    "tcp": {
        "bus", "confidence", "unconfirmed", "gap_us", "delimited_by", "elapsed_us", "source",
        "findings", "byte_offset", "byte_length", "frame", "txn", "client", "server", "connection",
        "mode", "mbap_id", "hex", "verdict", "line",
    },
}  # fmt: skip
"""Columns of frames that the packets alone do not tell.

Without options there are no words of ours: names, settings, what the framer knew. Gaps are those
between packets. The style tcp has other bytes: no checksums, identifiers, addresses.
"""


def test_classic_pcap_carries_the_frames(tmp_path: Path) -> None:
    """Bytes, times, framing, directions and verdicts of good frames."""
    for name in ("pymodbus_all_functions", "pymodbus_two_units", "pymodbus_exceptions"):
        source = recording(name)
        back = decode(export(source, tmp_path / "one.pcap"))
        skip = LESS["classic pcap"]
        assert rows(back, "frames", skip) == rows(source, "frames", skip)
        assert _content(back) == _content(source)


def test_the_style_tcp_carries_the_good_frames(tmp_path: Path) -> None:
    """Unit, function, exception, direction, time; what was asked and answered."""
    assert {key for keys in LESS.values() for key in keys} <= {one.key for one in columns("frames")}
    for name in ("pymodbus_all_functions", "pymodbus_two_units", "pymodbus_types"):
        source = recording(name)
        back = decode(export(source, tmp_path / "one.pcapng", options=styled("tcp")))
        skip = LESS["tcp"]
        assert rows(back, "frames", skip) == rows(source, "frames", skip)
        assert _content(back) == _content(source)


def _content(source: Decoding) -> list[tuple[Any, ...]]:
    """What transactions say of registers."""
    keys = ("unit", "function", "address", "quantity", "data", "write_address", "write_data",
            "fields", "status", "exception")  # fmt: skip
    return [tuple(getattr(row, key) for key in keys) for row in source.transactions]


def test_words_that_make_no_sense_are_no_words(tmp_path: Path) -> None:
    """A file may come from anywhere: what is not ours is read as its bytes are."""
    path = export(
        recording("pymodbus_two_units"), tmp_path / "one.pcapng", options=ExportOptions("", ())
    )
    data = path.read_bytes()
    for old, new in ((b"direction=re", b"direction=xy"), (b"txn=", b"txm="), (b"frame=", b"frame?"),
                     (b"request=", b"request?"), (b" offset=", b" cut_by=")):  # fmt: skip
        assert old in data
        changed = tmp_path / "changed.pcapng"
        changed.write_bytes(data.replace(old, new))
        assert b"".join(row.hex for row in decode(changed).frames) == b"".join(
            row.hex for row in recording("pymodbus_two_units").frames
        ), old
