"""The end of a tap by a condition: exactly N transactions, and the end is no finding."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import decode
from analyzer.cli.limited_run import LimitedRun
from analyzer.cli.triggers import StopConditions
from analyzer.exports.sink import ExportSink, parse_target
from analyzer.pump import pump
from tests.conftest import ROOT, command, environment

REQUEST, RESPONSE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
MS = 1_000_000


class Line:
    """A live run of exchanges, `burst` of them a batch, which ends with the bytes of `tail`."""

    def __init__(self, burst: int, tail: bytes = b"") -> None:
        self._core = _modlens.Session(
            _modlens.Functions(),
            live=True,
            tables=("frames", "transactions", "findings", "readings"),
        )
        self._bus = self._core.add_bus("bus", source="bus", mode="rtu", clock="utc")
        self._now = 10**18
        self._burst, self._tail = burst, tail

    def _send(self, data: bytes) -> None:
        self._now += 20 * MS
        self._core.feed(self._bus, data, self._now)

    def batches(self) -> Iterator[_modlens.Batch]:
        """Bursts without end; the tail is on the line whenever a batch is taken."""
        while True:
            for _ in range(self._burst):
                self._send(REQUEST)
                self._send(RESPONSE)
            if self._tail:
                self._send(self._tail)
            yield self._core.take()

    def finish(self) -> _modlens.Batch:
        """What is open."""
        self._core.flush()
        return self._core.take()

    def stats(self) -> dict[str, Any]:
        """The core's."""
        found: dict[str, Any] = json.loads(self._core.stats())
        return found

    def doctor(self) -> dict[str, Any]:
        """Nothing is judged here."""
        return {}

    def document(self) -> dict[str, Any]:
        """What both say."""
        return {"statistics": self.stats(), "doctor": self.doctor()}


def record(
    path: Path,
    run: Line,
    count: int | None = None,
    *,
    until: str | None = None,
    table: str = "transactions",
) -> LimitedRun:
    """Pump the run into a file as a tap does; gives the run for its statistics."""
    stop = StopConditions(count, None, until)
    sink = ExportSink(parse_target(str(path), table), columns=None, where=None, growing=True)
    limited = LimitedRun(run, count, lambda: stop.reached)

    def fail(sink: object, error: Exception) -> None:
        raise error

    pump(limited, [stop, sink], stop=lambda: stop.reached, on_failure=fail)
    sink.close()
    return limited


@pytest.mark.parametrize("burst", [1, 2, 5])
@pytest.mark.parametrize("tail", [b"", REQUEST, REQUEST[:4]])
@pytest.mark.parametrize("form", ["jsonl", "pcapng"])
def test_count_gives_exactly_that_many(form: str, tail: bytes, burst: int, tmp_path: Path) -> None:
    """Also where a batch brings several, and another frame has begun."""
    for count in (1, 3, 4):
        path = tmp_path / f"{count}.{form}"
        # A tail that further exchanges follow is a request without a response, or noise.
        is_last = burst >= count
        record(path, Line(burst, tail if is_last else b""), count)
        if form == "jsonl":
            rows = [json.loads(line) for line in path.read_text().splitlines()]
            assert [row["status"] for row in rows] == ["ok"] * count
            assert [row["txn"] for row in rows] == list(range(1, count + 1))
        else:
            statuses = [row.status for row in decode(path).transactions]
            assert statuses == ["ok"] * count


@pytest.mark.parametrize("table", ["frames", "transactions", "findings"])
@pytest.mark.parametrize("tail", [REQUEST[:4], REQUEST + RESPONSE[:3], REQUEST + RESPONSE[:6]])
def test_a_frame_that_the_end_cuts_off_is_no_finding(
    table: str, tail: bytes, tmp_path: Path
) -> None:
    """Neither in the rows nor in the statistics that `--strict` goes by."""
    path = tmp_path / "out.jsonl"
    limited = record(path, Line(2, tail), until="status == 'ok'", table=table)
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert not [row for row in rows if row.get("findings") or row.get("code")]
    assert not {row.get("verdict", "ok") for row in rows} - {"ok"}
    assert limited.stats()["findings"] == {}


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo terminals of POSIX")
def test_a_tap_of_a_burst_writes_no_row_more(tmp_path: Path) -> None:
    """Five exchanges and half a request arrive at once; `--count 3` writes three."""
    rows, findings = tmp_path / "rows.jsonl", tmp_path / "findings.jsonl"
    tty = pytest.importorskip("tty")
    leader, follower = os.openpty()
    tty.setraw(follower)
    running = subprocess.Popen(
        command(
            "tap", os.ttyname(follower), "--line", "19200-8E1", "--mode", "rtu", "--count", "3",
            "-o", rows, "-o", f"findings:{findings}",
        ),
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, env=environment(), cwd=ROOT,
    )  # fmt: skip
    assert running.stderr is not None
    assert b"listening" in running.stderr.readline()
    time.sleep(0.3)
    os.write(leader, (REQUEST + RESPONSE) * 5 + REQUEST[:4])
    assert running.wait(30) == 0
    running.stderr.close()
    os.close(leader)
    os.close(follower)
    assert rows.read_text().count("\n") == 3
    assert findings.read_text() == ""
