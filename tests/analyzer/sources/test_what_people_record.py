"""Recordings as people have them, which were misread once."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from analyzer import decode
from dissectors.errors import SourceError
from tests.conftest import Modlens
from tests.support import captures

REQUEST, RESPONSE = bytes.fromhex("050300100002c44a"), bytes.fromhex("05030400fa012c9f8f")


def test_the_shortest_ascii_frame_is_bytes_of_a_line(tmp_path: Path, modlens: Modlens) -> None:
    """Unit, function code and LRC; `--from raw` is right for it."""
    path = tmp_path / "line.txt"
    path.write_bytes(b":FF0100\r\n")
    done = modlens("decode", "--from", "raw", "--mode", "ascii", "--to", "jsonl", path)
    assert done.status == 0, done.err
    assert "1 frame (9 bytes): ok 1" in done.err


@pytest.mark.parametrize(
    ("frame", "address", "quantity"),
    [("0110000100021008", 1, 2), ("010f0013000a2409", 0x13, 10)],
)
def test_a_response_of_a_write_alone_tells_what_was_written(
    frame: str, address: int, quantity: int, tmp_path: Path
) -> None:
    """Address and quantity are in the response, too (application protocol, 6.11 and 6.12)."""
    path = tmp_path / "log.hex"
    path.write_text(frame)
    (txn,) = decode(path).transactions
    assert (txn.write_address, txn.write_quantity, txn.status) == (address, quantity, "unsolicited")


def test_a_right_checksum_is_not_called_wrong(modlens: Modlens) -> None:
    """An exception response with code 0, of a function that nobody knows."""
    done = modlens("show", "01 FF 00 61 F0")
    assert "CRC OK" in done.out
    assert "bad_checksum" not in done.out


def test_device_identification_is_text(tmp_path: Path, modlens: Modlens) -> None:
    """In the table, in JSON lines and in `show`."""
    response = "01 2b 0e 01 01 00 00 02 00 04 41 43 4d 45 01 02 50 31 1a ff"
    path = tmp_path / "log.hex"
    path.write_text(f"01 2b 0e 01 00 70 77\n{response}\n")
    assert 'VendorName="ACME"' in modlens("decode", path).out
    (row,) = modlens("decode", path, "--to", "jsonl").out.splitlines()
    fields = json.loads(row)["fields"]
    assert fields["identification"] == {"VendorName": "ACME", "ProductCode": "P1"}
    assert '"ACME"' in modlens("show", response).out


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux only")
def test_file_names_need_not_be_utf8(tmp_path: Path, modlens: Modlens) -> None:
    """They are read, and shown with the bytes that are no text."""
    name = os.fsdecode(os.fsencode(tmp_path / "caf") + b"\xe9.hex")
    Path(name).write_text(f"{REQUEST.hex()}\n{RESPONSE.hex()}\n")
    done = modlens("decode", name, "--to", "jsonl")
    assert done.status == 0, done.err
    assert json.loads(done.out)["source"].endswith("caf\\xe9.hex:1")
    assert "caf\\xe9.hex: hex" in done.err
    assert len(decode(name).frames) == 2
    assert modlens("stats", tmp_path).status == 0


def test_hexdump_without_its_column(tmp_path: Path) -> None:
    """Offsets, bytes and the length at the end; frames over the ends of lines."""
    data = (REQUEST + RESPONSE) * 3
    rows = [data[at : at + 16].hex(" ") for at in range(0, len(data), 16)]
    lines = [f"{16 * number:08x}  {row}" for number, row in enumerate(rows)]
    path = tmp_path / "dump.txt"
    path.write_text("\n".join([*lines, f"{len(data):08x}"]) + "\n")
    decoded = decode(path)
    assert [frame.hex for frame in decoded.frames] == [REQUEST, RESPONSE] * 3
    assert [txn.status for txn in decoded.transactions] == ["ok"] * 3


def test_frames_in_parts_are_joined_in_captures(tmp_path: Path) -> None:
    """Packets of link type 147 may be what one read returned, as lines of logs are."""
    packets = [REQUEST[:3], REQUEST[3:], RESPONSE[:4], RESPONSE[4:5], RESPONSE[5:], REQUEST]
    path = tmp_path / "parts.pcap"
    path.write_bytes(captures.pcap(147, packets))
    frames = decode(path).frames
    assert [frame.hex for frame in frames] == [REQUEST, RESPONSE, REQUEST]
    assert {frame.verdict for frame in frames} == {"ok"}


BLUETOOTH = """\
> HCI Event: LE Meta Event (0x3e) plen 26
        02 01 00 00 5c 3a 1b 22 c4 7c 0e 02 01 06 0a ff 4c 00 10 05 03 1c 7a
< ACL Data TX: Handle 64 flags 0x00 dlen 11
        07 00 04 00 10 01 00 ff ff 00 28
> ACL Data RX: Handle 64 flags 0x02 dlen 9
        40 20 00 00 00 09 00 05 00 04 00 01 10 2e 00
> ACL Data RX: Handle 64 flags 0x02 dlen 9
        41 20 00 00 00 05 04 00 1b 0c 00
"""


def test_a_log_of_bluetooth_is_refused(tmp_path: Path) -> None:
    """Two zeros and a length that fits are no MBAP header without a function after them."""
    path = tmp_path / "hci.log"
    path.write_text(BLUETOOTH * 5)
    with pytest.raises(SourceError):
        list(decode(path).frames)


def test_unread_lines_are_ranked_by_their_hex(tmp_path: Path, modlens: Modlens) -> None:
    """The line that a reader of the message should look at is first."""
    path = tmp_path / "log.txt"
    chatter = "".join(f"2026-11-21 12:30:{n:02} nothing to see\n" for n in range(9))
    lost = "block of 01 02 03 0A 05 06 07 08 09 10 bytes\n"
    path.write_text(f"{chatter}Tx: {REQUEST.hex(' ')}\n{lost}")
    said = modlens("decode", path).err
    assert "10 of 11 lines could not be parsed; 1 of them holds 10 bytes of hex" in said
    assert said.index("line 11: block") < said.index("line 1: 2026")


def test_what_is_skipped_is_reported_with_its_size(tmp_path: Path, modlens: Modlens) -> None:
    """How many items were left out does not show whether a whole answer is among them."""
    path = tmp_path / "log.txt"
    path.write_text(f"sent: {REQUEST.hex(' ')} (id 41 42 43 44 45 46)\n")
    said = modlens("decode", path).err
    assert "1 skipped: hex beside a frame that no checksum proves (6 bytes)" in said
