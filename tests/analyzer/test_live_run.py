"""A tap through the API: what its statistics say of the ports."""

from __future__ import annotations

import os
import sys
from contextlib import closing
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from analyzer.exports.recorder import Recorder
from analyzer.line import parse_line
from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from analyzer.sources import port_listener as sources
from analyzer.sources.serial import Port
from analyzer.views.live.health import lines
from analyzer.views.live.state import LiveState
from analyzer.views.row_lines import TableOptions
from tests.support.raw_recording import RTAC_HEAD, packets

PAIR = bytes.fromhex("010300000001840a0103020007f986")


def test_what_the_driver_counts_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ptys count nothing, so the counters are ours; what they had before the tap is not its own."""
    monkeypatch.setattr(sources, "CHECK_INTERVAL_NS", 0)
    counts = iter([{"overrun": 5, "frame": 1}, {"overrun": 5, "frame": 1}])
    monkeypatch.setattr(Port, "counters", lambda _: next(counts, {"overrun": 7, "frame": 4}))
    far, near = os.openpty()
    with closing(LiveRun([os.ttyname(near)], Settings(line=parse_line("19200-8E1")))) as run:
        batches = run.batches()
        next(batches)
        next(batches)
        os.write(far, PAIR)
        codes = [one.code for _ in range(8) for one in next(batches).findings]
        stats = run.stats()
        board = LiveState(TableOptions(buses=run.buses), run.stats)
        board.refresh()
        shown = ["".join(text for text, _ in line) for line in lines(board, 100, 20)]
    assert stats["buses"][0]["driver"] == {"overrun": 2, "frame": 3}
    assert "lost_bytes" in codes
    assert "  the driver counted 2 overruns of the chip (bytes lost), 3 framing errors" in shown
    for fd in (far, near):
        os.close(fd)


@pytest.mark.parametrize("wanted", [False, True])
def test_reads_go_to_the_engine_and_to_a_recorder(wanted: bool, tmp_path: Path) -> None:
    """With and without a recorder the rows are the same, and A+B keeps its lines."""
    pairs = [os.openpty() for _ in range(2)]
    name = "+".join(os.ttyname(near) for _, near in pairs)
    settings = Settings(line=parse_line("19200-8E1"))
    recorder = Recorder(str(tmp_path / "bus.pcapng"))
    with closing(LiveRun([name], settings)) as run:
        if wanted:
            run.record(recorder.core)
        batches = run.batches()
        os.write(pairs[0][0], PAIR[:8])
        next(batches)
        os.write(pairs[1][0], PAIR[8:])
        found = [row for _ in range(6) for row in next(batches).frames]
        found += list(run.finish().frames)
    rows = [(row.line, row.direction, row.hex) for row in found]
    assert rows == [("A", "request", PAIR[:8]), ("B", "response", PAIR[8:])]
    recorder.close()
    data = (tmp_path / "bus.pcapng").read_bytes()
    recorded = [(port, payload[RTAC_HEAD:]) for port, _, payload, _ in packets(data)]
    ends = [(0, b""), (1, b"")]
    assert recorded == ([(0, PAIR[:8]), (1, PAIR[8:]), *ends] if wanted else [])
    for fd in (fd for pair in pairs for fd in pair):
        os.close(fd)
