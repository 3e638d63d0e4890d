"""A saturated line through a pseudo terminal into `modlens tap`: loss, CPU time, latency.

    python bench/tap_load.py --seconds 600                  # lines to a file
    python bench/tap_load.py --seconds 600 --view table     # a screen of 160x50
    python bench/tap_load.py --seconds 60 --baud 3000000
    python bench/tap_load.py --seconds 1200 --load 0.4      # a soak: memory at its end

Requests and responses follow each other without a pause (`--load` 1), handed over each millisecond
as a USB adapter does. Latency is from the write of a response's last byte to the line that reports
it. CPU time is that of the whole tap process, its start left out. With `--floor` a loop of bare
reads listens to the same line at the same time: what it takes is what this machine, as busy as it
is, asks for waking a process a thousand times a second. Linux only.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import os
import pty
import re
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
import tty
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import _modlens

TICK_S = 0.001
CHAR_BITS = 11
MB = 1024
SCREEN_S = 10.0
"""Seconds to wait until a tap with a screen listens: its message is hidden by the screen."""

SIZE = struct.pack("4H", 50, 160, 0, 0)

BARE = "import os, sys\nfd = os.open(sys.argv[1], os.O_RDONLY)\nwhile os.read(fd, 4096): pass"
"""A program that only reads the line: the least CPU time possible, one wake-up for each read."""


@dataclass(slots=True)
class LoadResult:
    """The result of a run: bytes, share of one core, latencies in ms, kB of memory over time.

    `received_bytes` are the bytes of all frames; a machine that stalls may cut a frame in two,
    which loses no byte.
    """

    sent: int
    received_bytes: int
    good: int
    transactions: int
    cpu: float
    latencies_ms: list[float]
    memory_kb: list[int] = field(default_factory=list)
    floor: float | None = None


class BareReader:
    """A process that reads the same bytes and does nothing with them, as the floor of CPU time."""

    def __init__(self) -> None:
        """Start reading."""
        self.far, self._near = pty.openpty()
        tty.setraw(self._near)
        words = [sys.executable, "-c", BARE, os.ttyname(self._near)]
        self._process = subprocess.Popen(words)

    def cpu_s(self) -> float:
        """CPU seconds so far."""
        return cpu_s(self._process.pid)

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        os.close(self.far)
        os.close(self._near)


def traffic() -> list[bytes]:
    """Requests and responses of a poll list, alternating."""
    frames = []
    for unit in range(1, 9):
        count = (2, 10, 30, 60)[unit % 4]
        values = b"".join(struct.pack(">H", unit * 100 + place) for place in range(count))
        for body in (struct.pack(">BBHH", unit, 3, 0, count), bytes([unit, 3, 2 * count]) + values):
            frames.append(body + _modlens.crc16(body).to_bytes(2, "little"))
    return frames


class Lines:
    """Reads the tap's lines from a file, and when each came; of a screen it only reads."""

    def __init__(self, fd: int, *, screen: bool) -> None:
        """Begin to read."""
        self.times: list[float] = []
        self._fd, self._screen = fd, screen
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Read the rest, when the tap has ended."""
        self._ended.set()
        self._thread.join(30)

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                ended = self._ended.is_set()
                data = os.read(self._fd, 1 << 16)
                if not self._screen:
                    now = time.monotonic()
                    self.times += [now] * data.count(b"\n")
                if not data:
                    if ended:
                        return
                    time.sleep(TICK_S / 2)


def feed(  # noqa: PLR0913, PLR0917 - what a line is
    far: int, baud: int, load: float, seconds: float, pid: int, bare: BareReader | None = None
) -> tuple[int, list[float], list[int]]:
    """Write frames at the line's pace; gives bytes, times of complete responses, memory samples."""
    frames = traffic()
    stream, ends = b"".join(frames), [0]
    for frame in frames:
        ends.append(ends[-1] + len(frame))
    closing = [end for number, end in enumerate(ends) if number and number % 2 == 0]
    sent, done, memory = 0, [], []
    rate = baud / CHAR_BITS * load
    start = sampled = time.monotonic()
    while (now := time.monotonic()) - start < seconds or sent % len(stream):
        due = int((now - start) * rate)
        if now - start >= seconds:
            due = -(-sent // len(stream)) * len(stream)
        while sent < due:
            at = sent % len(stream)
            taken = os.write(far, stream[at : at + min(due - sent, 4000)])
            moment = time.monotonic()
            if bare is not None:
                os.write(bare.far, stream[at : at + taken])
            done += [moment for end in closing if at < end <= at + taken]
            sent += taken
        if now - sampled > max(seconds / 20, 1):
            sampled = now
            memory.append(resident(pid))
        time.sleep(TICK_S)
    return sent, done, memory


def resident(pid: int) -> int:
    """Memory of a process, kB."""
    text = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    match = re.search(r"VmRSS:\s+(\d+)", text)
    return int(match[1]) if match else 0


def cpu_s(pid: int) -> float:
    """CPU seconds that a process has used, its threads included."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def run(
    seconds: float,
    baud: int = 115200,
    load: float = 1.0,
    view: str | None = None,
    *,
    floor: bool = False,
) -> LoadResult:
    """Run one tap on one line for `seconds`."""
    far, near = pty.openpty()
    tty.setraw(near)
    words = [sys.executable, "-m", "analyzer", "tap", os.ttyname(near), "--line", f"{baud}-8E1"]
    words += ["--times", "elapsed"]
    if view is None:
        writer, path = tempfile.mkstemp(suffix=".log")
        reader = os.open(path, os.O_RDONLY)
        os.unlink(path)
    else:
        reader, writer = pty.openpty()
        fcntl.ioctl(writer, termios.TIOCSWINSZ, SIZE)
        words += ["--view", view]
    env = {**os.environ, "TERM": "xterm-256color"}
    tap = subprocess.Popen(
        words, stdin=writer if view else None, stdout=writer, stderr=subprocess.PIPE, env=env
    )
    os.close(writer)
    lines = Lines(reader, screen=view is not None)
    assert tap.stderr is not None
    if view is None:
        tap.stderr.readline()  # it listens
    time.sleep(1.0 if view is None else SCREEN_S)
    bare = BareReader() if floor else None
    time.sleep(1.0 if floor else 0.0)
    before, idle = cpu_s(tap.pid), bare.cpu_s() if bare else 0.0
    sent, done, memory = feed(far, baud, load, seconds, tap.pid, bare)
    used, idle = cpu_s(tap.pid) - before, bare.cpu_s() - idle if bare else 0.0
    if bare:
        bare.close()
    time.sleep(1.0)
    tap.send_signal(signal.SIGTERM)  # SIGINT is ignored in the background of a shell
    said = tap.communicate()[1].decode()
    lines.join()
    for fd in (far, near, reader):
        os.close(fd)
    found = re.search(r"frames? \(([\d,]+) bytes\): ok \d[\d,]* \(([\d,]+)\)", said)
    counted = re.search(r"([\d,]+) transactions?", said)
    shown = lines.times[1:]
    latencies = [1e3 * (line - end) for end, line in zip(done, shown, strict=False)]
    return LoadResult(
        sent,
        int(found[1].replace(",", "")) if found else 0,
        int(found[2].replace(",", "")) if found else 0,
        int(counted[1].replace(",", "")) if counted else 0,
        used / seconds,
        latencies,
        memory,
        idle / seconds if floor else None,
    )


def main() -> None:
    """Run the bench and print its results."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--baud", type=int, default=115200)
    parser.add_argument("--load", type=float, default=1.0)
    parser.add_argument("--view", default=None)
    parser.add_argument("--floor", action="store_true", help="beside it a loop of bare reads")
    options = parser.parse_args()
    done = run(options.seconds, options.baud, options.load, options.view, floor=options.floor)
    out = sys.stdout.write
    out(f"{options.baud} baud, {options.load:.0%} load, {options.seconds:.0f} s\n")
    out(f"sent {done.sent:,} bytes, lost {done.sent - done.received_bytes:,},")
    out(f" in good frames {done.good:,}\n")
    out(f"transactions {done.transactions:,}\n")
    out(f"CPU {done.cpu:.1%} of one core\n")
    if done.floor is not None:
        out(f"a loop of bare reads of the same line {done.floor:.1%}\n")
    if done.latencies_ms:
        cuts = statistics.quantiles(done.latencies_ms, n=100)
        out(f"last byte to line: p50 {cuts[49]:.1f} ms, p99 {cuts[98]:.1f} ms\n")
    if done.memory_kb:
        growth = [after - ahead for ahead, after in pairwise(done.memory_kb)]
        out(f"memory {done.memory_kb[0] / MB:.1f} to {done.memory_kb[-1] / MB:.1f} MiB,")
        out(f" largest step {max(growth, default=0) / MB:.1f} MiB\n")


if __name__ == "__main__":
    main()
