"""The recordings of real devices with a time for every byte, as three kinds of tap deliver them."""

from __future__ import annotations

import json

import pytest

import _modlens
from tests.captures.test_decode import CAPTURES, about, expected, line_settings
from tests.support.rechunk import TAPS, Byte

NAMES = ("brainchild_io_16do", "flowmeter_15l_min", "flowmeter_graph_tool")


def recorded(name: str) -> list[Byte]:
    """The bytes of a capture; each line of the file has one."""
    lines = (CAPTURES / name / about(name)["file"]).read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    return [(round(row["t"] * 1e9), row.get("line"), int(row["hex"], 16)) for row in rows]


@pytest.mark.parametrize("tap", TAPS)
@pytest.mark.parametrize("name", NAMES)
def test_every_tap_gives_exactly_the_frames(name: str, tap: str) -> None:
    session = _modlens.Session(_modlens.Functions())
    clock = "none" if tap == "untimed" else "relative"
    line = line_settings(about(name)["line"])
    bus = session.add_bus(name, source=name, line=line, clock=clock)
    for time, which, data in TAPS[tap](recorded(name)):
        session.feed(bus, data, time, line=which)
    session.flush()
    rows = list(session.take().frames)
    wanted = expected(name)
    for which in {frame.get("line") for frame in wanted}:
        found = [(row.hex.hex(), row.direction) for row in rows if row.line == which]
        told = [(one["hex"], one["direction"]) for one in wanted if one.get("line") == which]
        assert found == told
