"""What Wireshark sees with nothing configured: packet by packet against our records."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import Decoding, UsageError, decode
from analyzer.columns import TABLES
from analyzer.exports import ExportOptions
from analyzer.exports.sink import ExportSink, parse_target
from tests.conftest import CAPTURES, need_program
from tests.support.tshark import environment, fields, tshark

MIXED = (
    "pymodbus_all_functions",
    "pymodbus_exceptions",
    "pymodbus_broadcast",
    "pymodbus_disturbed",
    "pymodbus_ascii",
    "pymodbus_two_units",
    "pymodbus_late_answers",
)
"""Every function, exceptions, broadcasts, wrong checksums, noise, ASCII; each a bus of its own."""

OPAQUE = {7, 8, 11, 12, 17, 20, 21, 22, 23, 24, 43}
"""Functions for which tshark fills no register number or value, or not all (4.0 to 4.6)."""

NO_VALUE = {1, 2, 5, 6, 15}
"""Functions for which tshark 4.0 shows bits and single values as raw bytes."""


def recording(*names: str) -> Decoding:
    """These captures, one after the other."""
    return decode([CAPTURES / name / "recording.jsonl" for name in names])


def export(
    source: Decoding, path: Path, *, where: str | None = None, options: ExportOptions | None = None
) -> Path:
    """Write a recording to a capture."""
    sink = ExportSink(
        parse_target(str(path), "transactions"),
        columns=None,
        where=where,
        growing=False,
        options=options,
    )
    for batch in source.batches(*TABLES):
        sink.put(batch)
    sink.close()
    return path


def styled(style: str) -> ExportOptions:
    """A wish for a style."""
    return ExportOptions("", (), style=style)


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture of everything."""
    return export(recording(*MIXED), tmp_path_factory.mktemp("mixed") / "mixed.pcapng")


def test_nothing_is_malformed(mixed: Path) -> None:
    """No packet is malformed for tshark; its expert information is our comments only."""
    assert tshark(mixed, "-Y", "_ws.malformed || _ws.short") == ""
    experts = tshark(mixed, "-q", "-z", "expert")
    assert not any(word in experts for word in ("Errors", "Warns", "Notes", "Chats"))


def test_every_frame_is_a_packet_and_says_the_same(mixed: Path) -> None:
    """Unit, function, exception, time and bytes of every frame; requests of responses."""
    names = ["frame.number", "frame.time_epoch", "mbtcp.unit_id", "modbus.func_code"]
    names += [
        "modbus.exception_code",
        "modbus.request_frame",
        "udp.dstport",
        "frame.interface_name",
    ]
    seen = fields(mixed, names[:6] + names[7:])
    source = recording(*MIXED)
    frames = list(source.frames)
    pairs = {row.response_frame: row for row in source.transactions if row.response_frame}
    assert len(seen) == len(frames)
    good = {row.frame for row in frames if row.verdict == "ok"}
    paired = 0
    for packet, frame in zip(seen, frames, strict=True):
        assert packet["frame.interface_name"] == frame.bus
        moment = packet["frame.time_epoch"]
        assert abs(float(moment) - frame.time.timestamp()) < 2e-6
        if frame.verdict != "ok":
            assert packet["modbus.func_code"] == packet["mbtcp.unit_id"] == ""
            continue
        assert packet["mbtcp.unit_id"] == str(frame.unit)
        assert packet["modbus.func_code"] == str(frame.function)
        assert packet["modbus.exception_code"] == (
            "" if frame.exception is None else str(frame.exception)
        )
        asked = pairs[frame.frame].request_frame if frame.frame in pairs else None
        if frame.exception is None and asked in good and frame.direction == "response":
            assert packet["modbus.request_frame"] == str(asked), frame
            paired += 1
        else:
            assert packet["modbus.request_frame"] == "", frame
    assert paired > 150


def test_registers_and_values_are_those_of_our_records(mixed: Path) -> None:
    """Wherever tshark fills them: it numbers registers by the request that it found."""
    source = recording(*MIXED)
    rows = [row for row in source.transactions if row.status == "ok" and row.function not in OPAQUE]
    seen = fields(
        mixed,
        ["modbus.regnum16", "modbus.regval_uint16", "modbus.reference_num", "modbus.word_cnt"],
    )
    compared = 0
    for row in rows:
        if row.function in NO_VALUE:
            request = seen[row.request_frame - 1]
            first = row.address if row.address is not None else row.write_address
            assert request["modbus.reference_num"] == str(first)
            continue
        reads = row.operation == "read"
        packet = seen[(row.response_frame if reads else row.request_frame) - 1]
        start, values = (row.address, row.data) if reads else (row.write_address, row.write_data)
        numbers = ",".join(str(start + at) for at in range(len(values)))
        assert packet["modbus.regnum16"] == numbers, row
        assert packet["modbus.regval_uint16"] == ",".join(map(str, values)), row
        compared += 1
    assert compared > 60


def test_what_no_frame_is_says_so(mixed: Path) -> None:
    """Wrong checksums and noise: protocol column, flags and comments, the bytes as they were."""
    frames = list(recording(*MIXED).frames)
    seen = fields(
        mixed, ["_ws.col.Protocol", "data.data", "frame.packet_flags_crc_error", "frame.comment"]
    )
    kinds = {"bad_checksum": "RTU bad CRC", "noise": "RTU noise", "incomplete": "RTU incomplete"}
    met = set()
    for packet, frame in zip(seen, frames, strict=True):
        if frame.verdict in kinds and frame.mode == "rtu":
            assert packet["_ws.col.Protocol"] == kinds[frame.verdict]
            assert packet["data.data"] == frame.hex.hex()
            wrong = frame.verdict == "bad_checksum"
            assert (packet["frame.packet_flags_crc_error"] in ("1", "True")) == wrong
            assert not wrong or "the checksum does not match the bytes" in packet["frame.comment"]
            met.add(frame.verdict)
    assert met == set(kinds)


def test_findings_are_comments_in_words(mixed: Path) -> None:
    """Those of the frame and those of the pair, which are known later."""
    source = recording(*MIXED)
    seen = fields(mixed, ["frame.comment"])
    for row in source.findings:
        if row.frame is not None and row.code != "exception":
            assert f"{row.severity} {row.code}: " in seen[row.frame - 1]["frame.comment"], row
    refused = next(row for row in source.transactions if row.exception == 2)
    assert seen[refused.response_frame - 1]["frame.comment"].startswith("exception 2: ")


def test_ascii_keeps_its_text(tmp_path: Path) -> None:
    """The original follows the PDU and in the comment."""
    path = export(recording("pymodbus_ascii"), tmp_path / "ascii.pcapng")
    frames = list(recording("pymodbus_ascii").frames)
    seen = fields(path, ["frame.comment", "modbus.func_code", "frame.len"])
    for packet, frame in zip(seen, frames, strict=True):
        assert packet["modbus.func_code"] == str(frame.function)
        assert f"Modbus ASCII {frame.hex.decode().rstrip()}" in packet["frame.comment"]


def test_the_interface_tells_the_line(tmp_path: Path) -> None:
    """Name, settings and speed, as capinfos shows them; times have nanoseconds."""
    source = decode(CAPTURES / "pymodbus_two_units" / "recording.jsonl", line="19200-8E1")
    path = export(source, tmp_path / "one.pcapng")
    done = subprocess.run(
        [need_program("capinfos"), str(path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    for words in (
        "19200-8E1",
        "Speed = 19200",
        "nanoseconds (9)",
        "Wireshark Upper PDU",
        "modlens",
    ):
        assert words in done.stdout, words


@pytest.mark.parametrize("again", ["tshark", "editcap"])
def test_what_others_save_anew_keeps_our_words(again: str, mixed: Path, tmp_path: Path) -> None:
    """Comments, flags and custom options survive saving by other programs."""
    path = tmp_path / "again.pcapng"
    words = ["-r", str(mixed), "-w", str(path)] if again == "tshark" else [str(mixed), str(path)]
    subprocess.run(
        [need_program(again), *words],
        check=True,
        timeout=60,
        capture_output=True,
        env=environment(tmp_path),
    )
    names = ["frame.comment", "frame.packet_flags", "frame.time_epoch", "data.data"]
    assert fields(path, names) == fields(mixed, names)
    ours = (32473).to_bytes(4, "little") + b"frame="
    assert (
        path.read_bytes().count(ours)
        == mixed.read_bytes().count(ours)
        == len(list(recording(*MIXED).frames))
    )
    assert b" gap_us=" in path.read_bytes()


def test_the_style_rtu_is_decoded_as_rtu(tmp_path: Path) -> None:
    """By the dissector mbrtu, whose checks find every checksum right."""
    path = export(recording("pymodbus_two_units"), tmp_path / "rtu.pcapng", options=styled("rtu"))
    seen = fields(
        path, ["mbrtu.unit_id", "mbrtu.crc16.status"], "-o", "mbrtu.crc_verification:TRUE"
    )
    frames = list(recording("pymodbus_two_units").frames)
    assert [packet["mbrtu.unit_id"] for packet in seen] == [str(frame.unit) for frame in frames]
    assert {packet["mbrtu.crc16.status"] for packet in seen} <= {"1", "Good"}


def test_the_style_tcp_is_a_sound_conversation(tmp_path: Path) -> None:
    """TCP of the style `tcp` is consistent and marked as synthetic; omitted frames are counted."""
    path = export(recording(*MIXED), tmp_path / "tcp.pcapng", options=styled("tcp"))
    strict = ("-o", "tcp.check_checksum:TRUE", "-o", "ip.check_checksum:TRUE")
    assert tshark(path, *strict, "-Y", "tcp.analysis.flags || _ws.malformed") == ""
    assert tshark(path, *strict, "-Y", "ip.checksum.status == 0 || tcp.checksum.status == 0") == ""
    seen = fields(path, ["mbtcp.unit_id", "modbus.func_code"], "-Y", "mbtcp")
    good = [
        row
        for row in recording(*MIXED).frames
        if row.verdict == "ok" and row.direction != "unknown"
    ]
    assert [packet["mbtcp.unit_id"] for packet in seen] == [str(row.unit) for row in good]
    text = subprocess.run(
        ["capinfos", str(path)], capture_output=True, text=True, check=True, timeout=60
    )
    assert "SYNTHETIC" in text.stdout
    assert b"frames are not in this file" in path.read_bytes()


def test_the_style_tcp_keeps_the_ends_of_a_connection(tmp_path: Path) -> None:
    """Addresses, ports and identifiers of a captured connection are those of the capture."""
    source = CAPTURES / "pymodbus_tcp" / "recording.pcap"
    path = export(decode(source), tmp_path / "tcp.pcapng", options=styled("tcp"))
    names = ["ip.src", "tcp.srcport", "ip.dst", "tcp.dstport", "mbtcp.trans_id", "mbtcp.unit_id"]
    names.append("modbus.func_code")
    assert fields(path, names, "-Y", "mbtcp") == fields(source, names, "-Y", "mbtcp")
    strict = ("-o", "tcp.check_checksum:TRUE", "-o", "ip.check_checksum:TRUE")
    assert tshark(path, *strict, "-Y", "tcp.analysis.flags || _ws.malformed") == ""
    assert tshark(path, *strict, "-Y", "ip.checksum.status == 0 || tcp.checksum.status == 0") == ""


def test_classic_pcap_is_decoded_alike(tmp_path: Path, mixed: Path) -> None:
    """A classic pcap has the same packets without names and comments."""
    path = export(recording(*MIXED), tmp_path / "mixed.pcap")
    names = [
        "frame.time_epoch",
        "mbtcp.unit_id",
        "modbus.func_code",
        "modbus.request_frame",
        "data.data",
    ]
    assert fields(path, names) == fields(mixed, names)


@pytest.mark.parametrize("context", [0, 3])
def test_a_filter_keeps_whole_transactions(context: int, tmp_path: Path) -> None:
    """All frames of those for which it holds, and on request their neighbours."""
    source = recording("pymodbus_disturbed")
    where = "status == 'bad_response' or status == 'no_response'"
    path = export(
        source, tmp_path / "cut.pcapng", where=where, options=ExportOptions("", (), context=context)
    )
    wanted = {row.txn for row in source.transactions.where(where)}
    frames = list(source.frames)
    kept = [at for at, frame in enumerate(frames) if frame.txn in wanted]
    near = {other for at in kept for other in range(at - context, at + context + 1)}
    expected = [frames[at].frame for at in sorted(near) if 0 <= at < len(frames)]
    assert 5 < len(expected) < len(frames)
    data = path.read_bytes()
    ours = (32473).to_bytes(4, "little") + b"frame="
    numbers = [int(part.split(b" ")[0].rstrip(b"\0")) for part in data.split(ours)[1:]]
    assert numbers == expected


def test_a_filter_on_frames_keeps_those(tmp_path: Path) -> None:
    """`frames:` in front of the name filters frame by frame."""
    source = recording("pymodbus_disturbed")
    path = tmp_path / "noise.pcapng"
    sink = ExportSink(
        parse_target(f"frames:{path}", "transactions"),
        columns=None,
        where="verdict == 'noise'",
        growing=False,
    )
    for batch in source.batches(*TABLES):
        sink.put(batch)
    sink.close()
    seen = fields(path, ["_ws.col.Protocol"])
    assert [packet["_ws.col.Protocol"] for packet in seen] == ["RTU noise"] * sink.row_count
    assert sink.row_count > 2


def frame(unit: int, pdu: bytes) -> bytes:
    """An RTU frame."""
    body = bytes([unit]) + pdu
    return body + _modlens.crc16(body).to_bytes(2, "little")


def test_two_buses_of_many_transactions_never_mix(tmp_path: Path) -> None:
    """3000 transactions on each of two buses: every answer has its own request."""
    names = []
    for bus in range(2):
        parts = []
        for number in range(3000):
            address = (100 * bus + number) % 0x4000
            parts.append(frame(1, bytes([3]) + address.to_bytes(2) + b"\0\1"))
            parts.append(frame(1, bytes([3, 2]) + number.to_bytes(2)))
        path = tmp_path / f"bus{bus}.bin"
        path.write_bytes(b"".join(parts))
        names.append(path)
    source = decode(names, mode="rtu", read_as="raw")
    path = export(source, tmp_path / "two.pcapng")
    seen = fields(path, ["modbus.regnum16"], "-Y", "modbus.request_frame")
    wanted = [str(row.address) for row in source.transactions]
    assert len(wanted) == 6000
    assert [packet["modbus.regnum16"] for packet in seen] == wanted


@pytest.mark.skipif(sys.platform == "win32", reason="the CPU time of one child")
def test_answers_that_nobody_asked_for_are_read_in_linear_time(tmp_path: Path) -> None:
    """200,000 of them: Wireshark searches all requests of a pair of ports for each.

    With one pair of ports for all that takes 51 seconds, with new ones every 1000 transactions 1.3.
    """
    path, capture = tmp_path / "orphans.bin", tmp_path / "orphans.pcapng"
    answers = (frame(1, bytes([3, 2]) + (number & 0xFFFF).to_bytes(2)) for number in range(200_000))
    path.write_bytes(b"".join(answers))
    export(decode(path, mode="rtu", read_as="raw"), capture)
    process = subprocess.Popen(
        [need_program("tshark"), "-r", str(capture)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment(tmp_path),
    )  # fmt: skip
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    assert usage.ru_utime + usage.ru_stime < 3


def test_a_style_that_nobody_knows(tmp_path: Path) -> None:
    """Columns cannot be chosen, either; a table that a capture has no place for is refused."""
    with pytest.raises(UsageError, match="holds transactions or frames, not findings"):
        parse_target(f"findings:{tmp_path}/x.pcapng", "transactions")
    one = parse_target(f"{tmp_path}/x.pcapng", "transactions")
    with pytest.raises(UsageError, match="has columns of its own"):
        ExportSink(one, columns="txn", where=None, growing=False)


def test_scapy_reads_it(mixed: Path) -> None:
    """Times in nanoseconds, comments, names, and the bytes."""
    from scapy.utils import RawPcapNgReader  # noqa: PLC0415

    frames = list(recording(*MIXED).frames)
    with RawPcapNgReader(str(mixed)) as reader:
        packets: list[Any] = list(reader)
    assert len(packets) == len(frames)
    for (data, metadata), row in zip(packets, frames, strict=True):
        assert metadata.linktype == 252
        assert row.hex in data
        assert metadata.ifname.decode() == row.bus
