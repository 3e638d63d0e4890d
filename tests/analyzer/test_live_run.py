"""A tap through the API: what its statistics say of the ports."""

from __future__ import annotations

import os
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from _modlens import Tty
from analyzer import live_run
from analyzer.exports.recorder import Recorder
from analyzer.line import parse_line
from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from analyzer.views.live.health import lines
from analyzer.views.live.state import LiveState
from analyzer.views.row_lines import TableOptions
from tests.support.raw_recording import RTAC_HEAD, packets

PAIR = bytes.fromhex("010300000001840a0103020007f986")


class CountingPort:
    """A pty whose driver counts errors; what it had before the tap is not the tap's."""

    def __init__(self, name: str, line: str | None) -> None:
        """Open it."""
        self._port = Tty(name, line)
        self._counts = iter([{"overrun": 5, "frame": 1}, {"overrun": 5, "frame": 1}])

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def counters(self) -> dict[str, int]:
        """What it has counted."""
        return next(self._counts, {"overrun": 7, "frame": 4})


def test_what_the_driver_counts_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """An overrun is a loss, and the health screen says what was counted."""
    monkeypatch.setattr(live_run, "open_port", CountingPort)
    far, near = os.openpty()
    with closing(LiveRun([os.ttyname(near)], Settings(line=parse_line("19200-8E1")))) as run:
        batches = run.batches()
        until = time.monotonic() + 1.2
        while time.monotonic() < until:
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
