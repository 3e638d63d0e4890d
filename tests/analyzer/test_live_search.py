"""A tap that searches its settings: what happens where there is nothing to find, or no longer.

A pty has no rate: valid frames fit at once, and bytes that are no frames fit nowhere.
"""

from __future__ import annotations

import os
import random
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from analyzer.exports.recorder import Recorder
from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from tests.support.raw_recording import RTAC_HEAD, packets

PAIR = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
LONGEST_S = 20.0


@pytest.fixture
def pty() -> Iterator[tuple[int, str]]:
    """A pty: the descriptor to write to, and the name of the port."""
    far, near = os.openpty()
    yield far, os.ttyname(near)
    os.close(far)
    os.close(near)


def until(run: LiveRun, done: Callable[[], bool], act: Callable[[], None]) -> int:
    """Let the tap listen until something is so; gives the transactions that it decoded."""
    end = time.monotonic() + LONGEST_S
    transactions = 0
    for batch in run.batches():
        transactions += len([row for row in batch.transactions if row.status == "ok"])
        if done():
            return transactions
        assert time.monotonic() < end
        act()
    return transactions


def test_what_a_search_without_result_heard_is_kept(pty: tuple[int, str], tmp_path: Path) -> None:
    """Every byte reaches the recording and the rows, and the end says what it may be."""
    far, name = pty
    said: list[str] = []
    rng = random.Random(1)
    sent = bytearray()

    def noise() -> None:
        data = rng.randbytes(40)
        time.sleep(0.03)
        sent.extend(data)
        os.write(far, data)

    settings = Settings(tables=("frames", "transactions", "findings"))
    run = LiveRun([name], settings, notify=said.append)
    recorder = Recorder(str(tmp_path / "bus.pcapng"))
    with closing(run):
        run.record(recorder.core)
        until(run, lambda: len(sent) > 1500, noise)
        rows = run.finish()
        counted = run.stats()["buses"]
    recorder.close()
    (data,) = [one.read_bytes() for one in tmp_path.iterdir()]
    reads = [payload[RTAC_HEAD:] for _, _, payload, _ in packets(data)]
    recorded = b"".join(reads)
    # The first milliseconds after each change of the settings belong to those before.
    assert len(recorded) > 400
    assert all(bytes(sent).find(data) >= 0 for data in reads if data)
    assert b" settings=" in data
    assert sum(sum(bus["bytes"].values()) for bus in counted) == len(recorded)
    assert sum(len(row.hex) for row in rows.frames) == len(recorded)
    assert any("no line settings fit" in text for text in said), said


def test_nothing_received_is_said(pty: tuple[int, str]) -> None:
    """A silent line has a diagnosis as well."""
    said: list[str] = []
    with closing(LiveRun([pty[1]], Settings(), notify=said.append)) as run:
        next(run.batches())
        run.finish()
    assert any("nothing was received" in text for text in said), said


def test_settings_that_turn_out_wrong_are_searched_again(pty: tuple[int, str]) -> None:
    """Frames, then nothing but noise, then frames: found, searched again, found again."""
    far, name = pty
    said: list[str] = []
    rng = random.Random(2)

    def poll() -> None:
        for half in PAIR:
            time.sleep(0.03)
            os.write(far, half)

    def noise() -> None:
        time.sleep(0.02)
        os.write(far, rng.randbytes(60))

    def times(word: str) -> int:
        return sum(word in text for text in said)

    with closing(LiveRun([name], Settings(), notify=said.append)) as run:
        until(run, lambda: times("found") == 1, poll)
        assert run.statuses()[0].origin == "found"
        until(run, lambda: times("no valid frame in the last") == 1, noise)
        assert run.statuses()[0].origin == "searching"
        until(run, lambda: times("found") == 2, poll)
        answered = 0
        end = time.monotonic() + LONGEST_S
        for batch in run.batches():
            answered += sum(row.status == "ok" for row in batch.transactions)
            if answered > 2:
                break
            assert time.monotonic() < end
            poll()
        names = [bus["bus"] for bus in run.stats()["buses"]]
    assert set(names) == {name}
