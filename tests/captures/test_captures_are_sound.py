"""Every capture is what its `about.toml` and `frames.jsonl` say, judged without modlens.

Checksums are computed bit by bit here, on purpose: the core's are what captures are there to test.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

CAPTURES = Path(__file__).parents[2] / "captures"
FOLDERS = sorted(path for path in CAPTURES.iterdir() if path.is_dir())

ABOUT_KEYS = {
    "name": r"[a-z0-9_]+",
    "file": r"recording\.[a-z]+",
    "format": r"chunks|hex|raw|pcap",
    "origin": r".+",
    "licence": r".+",
    "line": r"[1-9][0-9]+-[78][NEO][12]",
    "mode": r"rtu|ascii|tcp",
    "shows": r".+",
    "recorded_with": r".+",
    "expected_source": r".+",
    "command": r"modlens decode captures/.+",
}
VERDICTS = {"ok", "bad_checksum", "incomplete", "noise"}
LARGEST = 150_000
CHUNK_LINE = re.compile(r'\{"t": \d+\.\d{6}, "hex": "([0-9a-f]{2})+"(, "line": "[A-Z]")?\}')
CLOCK_TOLERANCE_S = 0.02
PORT = 502

pytestmark = pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)


def about(folder: Path) -> dict[str, Any]:
    """Return what the capture says about itself."""
    return tomllib.loads((folder / "about.toml").read_text(encoding="utf-8"))


def expected_frames(folder: Path) -> list[dict[str, Any]]:
    """Return the expected frames."""
    return [json.loads(line) for line in (folder / "frames.jsonl").read_text().splitlines()]


def chunks(folder: Path) -> list[dict[str, Any]]:
    """Return the reads of a chunk log; no reads for other formats."""
    if about(folder)["format"] != "chunks":
        return []
    text = (folder / about(folder)["file"]).read_text(encoding="ascii")
    return [json.loads(line) for line in text.splitlines()]


def recorded(folder: Path) -> dict[str, str]:
    """Return the recording's bytes as hex, by line of a two-line tap."""
    form, path = about(folder)["format"], folder / about(folder)["file"]
    if form == "raw":
        return {"": path.read_bytes().hex()}
    if form == "pcap":
        return segments(path)
    if form == "hex":
        lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
        return {"": bytes.fromhex(" ".join(lines)).hex()}
    return joined(chunks(folder))


def segments(path: Path) -> dict[str, str]:
    """Return what a connection's client (A) and its server (B) sent; nothing of it was lost."""
    scapy = pytest.importorskip("scapy.all")
    lines: dict[str, str] = defaultdict(str)
    for packet in scapy.rdpcap(str(path)):
        data = bytes(packet[scapy.TCP].payload)
        lines["A" if packet[scapy.TCP].dport == PORT else "B"] += data.hex()
    return lines


def joined(pieces: list[dict[str, Any]]) -> dict[str, str]:
    """Join the hex of chunks or frames, by line of a two-line tap."""
    lines: dict[str, str] = defaultdict(str)
    for piece in pieces:
        lines[piece.get("line", "")] += piece["hex"]
    return lines


def crc16(data: bytes) -> int:
    """CRC-16/MODBUS, bit by bit (serial line specification, 6.2.2)."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def decoded(wire: bytes, mode: str) -> bytes | None:
    """Return the ADU without its checksum, or None where the checksum is wrong."""
    if mode == "tcp":
        right = wire[2:4] == b"\0\0" and int.from_bytes(wire[4:6]) == len(wire) - 6
        return wire[6:] if right else None
    if mode == "rtu":
        right = len(wire) >= 4 and crc16(wire[:-2]) == int.from_bytes(wire[-2:], "little")
        return wire[:-2] if right else None
    match = re.fullmatch(rb":((?:[0-9A-F]{2})+)\r\n", wire)
    if match is None:
        return None
    adu = bytes.fromhex(match[1].decode("ascii"))
    return adu[:-1] if sum(adu) % 256 == 0 else None


def test_the_folder_holds_three_files(folder: Path) -> None:
    """Recording, expectation and description, nothing else, none of them large."""
    files = {path.name: path.stat().st_size for path in folder.iterdir()}
    assert set(files) == {"about.toml", "frames.jsonl", about(folder)["file"]}
    assert all(0 < size < LARGEST for size in files.values())


def test_it_says_all_about_itself(folder: Path) -> None:
    """All keys, each of its form; the command names the capture's own file.

    `healthy` says whether somebody who looks for trouble on that line should find none.
    """
    table = about(folder)
    assert isinstance(table.pop("healthy"), bool)
    assert set(table) == set(ABOUT_KEYS) - ({"line"} if table["mode"] == "tcp" else set())
    assert {key for key in table if not re.fullmatch(ABOUT_KEYS[key], table[key])} == set()
    assert table["name"] == folder.name
    assert f"captures/{folder.name}/{table['file']}" in table["command"].split()


def test_no_path_of_a_machine_is_in_it(folder: Path) -> None:
    """A capture does not tell where it was made."""
    for path in folder.iterdir():
        assert not re.search(rb"/(home|root|tmp|work|Users)/", path.read_bytes()), path.name


def test_the_frames_tile_the_recording(folder: Path) -> None:
    """Joined, the expected frames are the recorded bytes, on each line."""
    frames = expected_frames(folder)
    assert frames
    assert joined(frames) == recorded(folder)


def test_checksums_are_what_the_frames_claim(folder: Path) -> None:
    """`ok` is right, every other verdict is not, and the other keys agree with the bytes."""
    mode = about(folder)["mode"]
    for frame in expected_frames(folder):
        assert frame["verdict"] in VERDICTS
        adu = decoded(bytes.fromhex(frame["hex"]), mode)
        assert (adu is not None) == (frame["verdict"] == "ok"), frame
        if adu is not None:
            assert (frame["unit"], frame["function"]) == (adu[0], adu[1] & 0x7F), frame
            assert frame.get("exception") == (adu[2] if adu[1] & 0x80 else None), frame


def test_frames_say_who_sent_them(folder: Path) -> None:
    """All but noise have a direction, a unit and a function; keys come in one order."""
    order = ["line", "direction", "unit", "function", "exception", "verdict", "hex"]
    for frame in expected_frames(folder):
        assert [key for key in order if key in frame] == list(frame)
        noise = frame["verdict"] == "noise"
        assert (frame.get("direction") in {"request", "response"}) != noise, frame
        assert ({"unit", "function"} <= set(frame)) != noise, frame


def test_chunk_logs_have_plausible_times(folder: Path) -> None:
    """One form of line, times that never run back, and no line faster than its baud rate."""
    table, reads = about(folder), chunks(folder)
    if not reads:
        assert table["format"] != "chunks"
        return
    text = (folder / table["file"]).read_text(encoding="ascii")
    assert all(CHUNK_LINE.fullmatch(line) for line in text.splitlines())
    times = [read["t"] for read in reads]
    assert times == sorted(times)
    baud, data_bits, parity, stop_bits = re.findall(r"\d{3,}|\d|[NEO]", table["line"])
    char_bits = 1 + int(data_bits) + (parity != "N") + int(stop_bits)
    count = sum(len(read["hex"]) // 2 for read in reads[1:])
    assert times[-1] - times[0] >= count * char_bits / int(baud) - CLOCK_TOLERANCE_S
