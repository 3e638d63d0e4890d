"""The tap for gateways when things around it fail: real ptys, real processes."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import _modlens
from tests.conftest import environment

if sys.platform != "linux":
    pytest.skip("the gateway's tap is for Linux", allow_module_level=True)

import pty
import tty

from tests.faults.opening import GATEWAY, build_gateway

PAIR = bytes.fromhex("010300000001840a0103020007f986")
PATIENCE_S = 20.0
RUNNING: list[subprocess.Popen[bytes]] = []
"""Taps that a test has started; none of them stays."""


@pytest.fixture(scope="module", autouse=True)
def _gateway() -> None:
    build_gateway()


@pytest.fixture
def port() -> Iterator[tuple[int, str]]:
    """A pseudo terminal: where to write, and the port's name."""
    far, near = pty.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    os.close(far)
    os.close(near)
    for running in RUNNING:
        running.kill()
        running.communicate()
    RUNNING.clear()


def tap(name: str, *words: str, cwd: Path) -> subprocess.Popen[bytes]:
    """A tap that listens."""
    running = subprocess.Popen(
        [str(GATEWAY), name, "--line", "19200-8E1", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=cwd, env=environment(),
    )  # fmt: skip
    RUNNING.append(running)
    assert running.stderr is not None
    assert b"listening to" in running.stderr.readline()
    return running


def talk(far: int, done: Callable[[], bool]) -> None:
    """Send exchanges until something is so."""
    until = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < until
        os.write(far, PAIR)
        time.sleep(0.005)


def stop(running: subprocess.Popen[bytes]) -> tuple[int, str]:
    """One SIGTERM; the status, and what it said."""
    running.send_signal(signal.SIGTERM)
    _, said = running.communicate(timeout=PATIENCE_S)
    RUNNING.remove(running)
    return running.returncode, said.decode()


def test_a_full_disk_ends_the_rows_only(port: tuple[int, str], tmp_path: Path) -> None:
    """The recording goes on, the file has whole rows, and the status says 3."""
    running = tap(port[1], "-o", "rows.jsonl", "--record", "bus.pcapng", cwd=tmp_path)
    rows, recording = tmp_path / "rows.jsonl", tmp_path / "bus.pcapng"
    talk(port[0], lambda: rows.stat().st_size > 2000)
    limit = rows.stat().st_size + 100
    _, hard = resource.prlimit(running.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(running.pid, resource.RLIMIT_FSIZE, (limit, hard))
    talk(port[0], lambda: recording.stat().st_size > limit - 200)
    resource.prlimit(running.pid, resource.RLIMIT_FSIZE, (hard, hard))
    talk(port[0], lambda: recording.stat().st_size > limit + 1000)
    status, said = stop(running)
    assert status == 3
    assert "rows.jsonl: cannot be written" in said
    assert " 0 lost" in said
    assert rows.read_bytes().endswith(b"\n")


def test_a_full_disk_that_recovered_is_told_by_the_status(
    port: tuple[int, str], tmp_path: Path
) -> None:
    """Nothing is missing in the recording, but somebody should look at the disk."""
    running = tap(port[1], "--quiet", "--record", "bus.pcapng", cwd=tmp_path)
    recording = tmp_path / "bus.pcapng"
    talk(port[0], lambda: recording.stat().st_size > 1000)
    _, hard = resource.prlimit(running.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(running.pid, resource.RLIMIT_FSIZE, (50, hard))
    until = time.monotonic() + 1.0
    talk(port[0], lambda: time.monotonic() > until)
    resource.prlimit(running.pid, resource.RLIMIT_FSIZE, (hard, hard))
    talk(port[0], lambda: len(list(tmp_path.glob("bus*.pcapng"))) > 1)
    status, said = stop(running)
    assert (status, "recording again" in said, " 0 lost" in said) == (3, True, True), said


def test_one_signal_ends_it_while_nobody_reads(port: tuple[int, str], tmp_path: Path) -> None:
    """Standard output is a pipe that is full; every byte is recorded all the same."""
    running = tap(port[1], "--record", "bus.pcapng", cwd=tmp_path)
    recording = tmp_path / "bus.pcapng"
    talk(port[0], lambda: recording.stat().st_size > 40_000)
    running.send_signal(signal.SIGTERM)
    assert running.wait(PATIENCE_S) == 0


def test_a_fifo_without_a_reader_obeys_the_first_signal(
    port: tuple[int, str], tmp_path: Path
) -> None:
    """It listens and records meanwhile."""
    os.mkfifo(tmp_path / "fifo")
    running = tap(port[1], "-o", "fifo", "--record", "bus.pcapng", cwd=tmp_path)
    talk(port[0], lambda: (tmp_path / "bus.pcapng").stat().st_size > 2000)
    status, said = stop(running)
    assert status == 0
    assert "dropped: nobody read them" in said


def test_a_second_tap_is_refused(port: tuple[int, str], tmp_path: Path) -> None:
    """Two on one port would each get a part of the bytes."""
    running = tap(port[1], cwd=tmp_path)
    words = [str(GATEWAY), port[1], "--line", "19200-8E1"]
    second = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (second.returncode, "in use by another program" in second.stderr) == (4, True)
    assert stop(running)[0] == 0


def test_a_closed_descriptor_is_an_error() -> None:
    """-1 is what a closed socket has for a descriptor."""
    with pytest.raises(OSError, match="-1"):
        _modlens.Inbox().listen(0, -1)
