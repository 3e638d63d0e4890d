"""Every capture decodes to the frames that its second source says were on the line."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

import _modlens

CAPTURES = Path(__file__).parents[2] / "captures"
NAMES = sorted(folder.name for folder in CAPTURES.iterdir() if folder.is_dir())
BLOCKS = (1, 7, 64, 1 << 20)


def about(name: str) -> dict[str, Any]:
    return tomllib.loads((CAPTURES / name / "about.toml").read_text())


def line_settings(text: str) -> tuple[int, int, str, float]:
    baud, rest = text.split("-")
    return int(baud), int(rest[0]), rest[1], float(rest[2:])


def decoded(name: str, block: int = 1 << 20) -> list[dict[str, Any]]:
    """Frames of a capture, fed in blocks of this many bytes of the file."""
    facts = about(name)
    data = (CAPTURES / name / facts["file"]).read_bytes()
    session = _modlens.Session(_modlens.Functions())
    if facts["format"] == "pcap":
        capture = session.add_capture(name)
        for start in range(0, len(data), block):
            session.feed_capture(capture, data[start : start + block])
        session.feed_capture(capture, b"", final=True)
        session.flush()
        return [row.as_dict() for row in session.take().frames]
    bus = session.add_bus(name, source=name, line=line_settings(facts["line"]))
    if facts["format"] != "raw":
        session.open_text(bus, facts["format"])
    for start in range(0, len(data), block):
        piece = data[start : start + block]
        if facts["format"] == "raw":
            session.feed(bus, piece)
        else:
            session.feed_text(bus, piece)
    if facts["format"] != "raw":
        session.feed_text(bus, b"", final=True)
    session.flush()
    return [row.as_dict() for row in session.take().frames]


def expected(name: str) -> list[dict[str, Any]]:
    lines = (CAPTURES / name / "frames.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


@pytest.mark.parametrize("name", NAMES)
def test_frames_equal_the_second_source(name: str) -> None:
    rows = decoded(name)
    good = [row for row in rows if row["verdict"] in ("ok", "no_checksum")]
    told = [frame for frame in expected(name) if frame["verdict"] in ("ok", "no_checksum")]
    if any("line" in frame for frame in told):
        good.sort(key=lambda row: (row["elapsed_us"], row["frame"]))
    assert [row["hex"].hex() for row in good] == [frame["hex"] for frame in told]
    for row, frame in zip(good, told, strict=True):
        assert row["direction"] == frame["direction"], frame
        assert row["unit"] == frame["unit"]
        assert row["function"] == frame["function"]
        assert row["exception"] == frame.get("exception")


@pytest.mark.parametrize("name", NAMES)
def test_damaged_frames_are_reported_as_damaged(name: str) -> None:
    bad = {row["hex"].hex() for row in decoded(name) if row["verdict"] != "ok"}
    for frame in expected(name):
        if frame["verdict"] in ("bad_checksum", "incomplete"):
            assert frame["hex"] in bad, frame


@pytest.mark.parametrize("name", NAMES)
def test_frames_tile_the_recording(name: str) -> None:
    places: dict[str | None, int] = {}
    for row in decoded(name):
        # each direction of each connection is a stream
        stream = f"{row['connection']} {row['direction']}" if row["mode"] == "tcp" else row["line"]
        assert row["byte_offset"] == places.get(stream, 0)
        assert row["byte_length"] == len(row["hex"])
        places[stream] = row["byte_offset"] + row["byte_length"]
    assert sum(places.values()) == sum(len(frame["hex"]) // 2 for frame in expected(name))


@pytest.mark.parametrize("block", BLOCKS[:-1])
@pytest.mark.parametrize("name", NAMES)
def test_blocks_of_any_size_give_equal_frames(name: str, block: int) -> None:
    assert decoded(name, block) == decoded(name)
