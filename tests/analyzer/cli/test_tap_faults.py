"""What a tap does when things around it fail; real ptys, real processes, a real load."""

from __future__ import annotations

import csv
import json
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import threading
import time
import tty
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from analyzer.line import Line, parse_line
from bench import tap_load
from tests.conftest import ROOT, command, environment
from tests.support.uart import Uart, Wire

REQUEST, RESPONSE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
PAIR = REQUEST + RESPONSE


class Wired:
    """A pty whose near end is a port."""

    def __init__(self) -> None:
        """Make it."""
        self.far, self._near = pty.openpty()
        tty.setraw(self._near)
        self.name = os.ttyname(self._near)

    def close(self) -> None:
        """Both ends."""
        os.close(self.far)
        os.close(self._near)


def tap(port: str, *words: str | Path, stdout: int = subprocess.DEVNULL) -> subprocess.Popen[str]:
    """A tap that listens."""
    running = subprocess.Popen(
        command("tap", port, "--line", "115200-8N1", *words),
        stdout=stdout,
        stderr=subprocess.PIPE,
        env=environment(),
        cwd=ROOT,
        text=True,
    )
    assert running.stderr is not None
    assert "listening" in running.stderr.readline()
    time.sleep(0.3)
    return running


def end(running: subprocess.Popen[str]) -> str:
    """Ctrl-C; what it said at its end."""
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    return said


@pytest.mark.parametrize(("baud", "seconds"), [(115200, 8.0), (3_000_000, 2.0)])
def test_not_a_byte_is_lost_at_full_load(baud: int, seconds: float) -> None:
    """A saturated line, a line on the screen for each transaction (`make load` takes minutes)."""
    done = tap_load.run(seconds, baud)
    assert done.received_bytes == done.sent > 0
    assert done.transactions > 0


def test_a_stalled_display_loses_nothing(tmp_path: Path) -> None:
    """Its reader stands still for five seconds; the file and the display have every row."""
    wired = Wired()
    rows, shown = tmp_path / "rows.jsonl", tmp_path / "shown.txt"
    with shown.open("wb") as file:
        display = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=file)
    assert display.stdin is not None
    running = tap(wired.name, "-o", rows, stdout=display.stdin.fileno())
    display.stdin.close()
    display.send_signal(signal.SIGSTOP)
    count = 4000  # lines for more than a pipe holds
    until = time.monotonic() + 5.0
    for _ in range(count // 40):
        os.write(wired.far, PAIR * 40)
        time.sleep(0.02)
    time.sleep(max(until - time.monotonic(), 0))
    display.send_signal(signal.SIGCONT)
    time.sleep(1.0)
    said = end(running)
    assert display.wait(30) == 0
    wired.close()
    assert f"{count:,} transactions: ok {count:,}" in said
    assert len(rows.read_text().splitlines()) == count
    assert shown.read_text().count(" ok 7") == count


def test_a_closed_pipe_ends_the_tap() -> None:
    """`modlens tap PORT | head` ends without an error when the reader has closed the pipe."""
    wired = Wired()
    running = tap(wired.name, stdout=subprocess.PIPE)
    assert running.stdout is not None
    os.write(wired.far, PAIR)
    assert "no." in running.stdout.readline()
    running.stdout.close()
    until = time.monotonic() + 10.0
    while running.poll() is None and time.monotonic() < until:
        os.write(wired.far, PAIR)
        time.sleep(0.05)
    assert running.poll() == 0
    assert running.stderr is not None
    assert running.stderr.read() == ""
    running.stderr.close()
    wired.close()


def test_a_full_disk_stops_one_file_only(tmp_path: Path) -> None:
    """The error is reported at once, the other file is complete, the exit status is 3."""
    wired = Wired()
    (tmp_path / "full.csv").symlink_to("/dev/full")
    rows = tmp_path / "rows.jsonl"
    running = tap(wired.name, "-o", tmp_path / "full.csv", "-o", rows)
    for _ in range(20):
        os.write(wired.far, PAIR)
        time.sleep(0.02)
    time.sleep(0.3)
    said = end(running)
    wired.close()
    assert "no space left" in said
    assert running.returncode == 3
    assert len(rows.read_text().splitlines()) == 20


def test_ends_by_itself(tmp_path: Path) -> None:
    """After so many transactions, after a time; the outputs are whole."""
    for words, least in ((("--count", "5"), 5), (("--duration", "600ms"), 0)):
        wired = Wired()
        rows = tmp_path / f"{words[0].strip('-')}.jsonl"
        running = tap(wired.name, "-o", rows, *words)
        for _ in range(10):
            os.write(wired.far, PAIR)
            time.sleep(0.05)
        _, said = running.communicate(timeout=30)
        wired.close()
        assert running.returncode == 0, said
        assert len(rows.read_text().splitlines()) >= least


def test_a_bus_has_a_name_and_settings_of_its_own(tmp_path: Path) -> None:
    """NAME=PORT@SETTINGS gives a bus its name and settings."""
    wired, rows = Wired(), tmp_path / "rows.jsonl"
    running = tap(f"boiler={wired.name}@9600-8N1", "-o", rows)
    os.write(wired.far, PAIR)
    time.sleep(0.4)
    end(running)
    wired.close()
    (row,) = [json.loads(line) for line in rows.read_text().splitlines()]
    assert row["bus"] == "boiler"


class Model:
    """A line made of bits on a pty: the port hears what a UART with its settings would.

    The kernel reports the far end which rate the near end has set; ptys have no parity, so the
    model's line has none.
    """

    def __init__(self, line: Line) -> None:
        """Begin to poll at 20 % load."""
        self.wired = Wired()
        self._line = line
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._stop.set()
        self._thread.join()
        self.wired.close()

    def _run(self) -> None:
        names = {
            getattr(termios, f"B{baud}", -1): baud
            for baud in (
                1200,
                2400,
                4800,
                9600,
                19200,
                38400,
                57600,
                115200,
                230400,
                460800,
                500000,
                921600,
            )
        }
        wire, now = Wire(self._line), 0.0
        start = time.monotonic()
        while not self._stop.is_set():
            begun = now
            now = wire.send(RESPONSE, wire.send(REQUEST, now) + 0.005)
            speed = termios.tcgetattr(self.wired.far)[4]
            heard = Uart(Line(names.get(speed, 9600), 8, "N", 1)).receive(wire, begun)
            os.write(self.wired.far, bytes(one.byte for one in heard))
            now = begun + 5 * (now - begun)
            time.sleep(max(start + now - time.monotonic(), 0))


def tapped(model: Model, *words: str | Path) -> str:
    """What a tap of this line says until it ends by itself."""
    running = subprocess.Popen(
        command("tap", model.wired.name, *words),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env=environment(),
        cwd=ROOT,
        text=True,
    )
    _, said = running.communicate(timeout=60)
    model.close()
    assert running.returncode == 0, said
    return said


def test_a_tap_finds_the_rate_and_goes_on(tmp_path: Path) -> None:
    """The whole way: a port without settings, the evidence on standard error, then every row."""
    model, rows = Model(parse_line("19200-8N1")), tmp_path / "rows.jsonl"
    said = tapped(model, "-o", rows, "--count", "30")
    assert "looks like 19200 baud" in said
    assert "found 19200-" in said
    found = [json.loads(line) for line in rows.read_text().splitlines()]
    assert [row["status"] for row in found[1:]] == ["ok"] * (len(found) - 1)
    assert len(found) >= 30


def test_a_recording_begins_when_the_settings_are_found(tmp_path: Path) -> None:
    """With the reads that were the evidence, and the settings; `decode` gives the tap's rows."""
    model, rows, raw = Model(parse_line("19200-8N1")), tmp_path / "rows.csv", tmp_path / "r.pcapng"
    words = ("-o", rows, "--record", raw, "--count", "20")
    tapped(model, *words)
    assert re.search(rb"settings=19200-8E?N?\d name=", raw.read_bytes())
    again = subprocess.run(
        command("decode", raw, "--replay", "--line", "19200-8N1", "--to", "csv"),
        capture_output=True, check=True, env=environment(), cwd=ROOT, text=True,
    )  # fmt: skip
    with rows.open(newline="") as file:
        live = [(row["request_hex"], row["response_hex"]) for row in csv.DictReader(file)]
    found = list(csv.DictReader(again.stdout.splitlines()))
    assert [(row["request_hex"], row["response_hex"]) for row in found] == live
