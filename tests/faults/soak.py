"""A tap with everything against it at once; `make soak` takes ten minutes.

    python -m tests.faults.soak --seconds 600

The line is polled fifty times a second. Meanwhile nobody reads standard output, the broker goes
away and comes back, the disk is full for a while, the port is unplugged twice, and somebody sets
the clock forward by years. In the end the raw recording has every byte that was sent, the holes
are marked, the rows are whole, memory has not grown, and one signal was enough.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from tests.analyzer.feeds.test_mqtt import Mosquitto
from tests.conftest import ROOT, environment
from tests.support.far_end import FarEnd
from tests.support.raw_recording import RTAC_HEAD, packets

PAIR = bytes.fromhex("010300000001840a0103020007f986")
PAUSE_S = 0.02
HOLE = 6
"""The event of a hole in a raw recording."""


@dataclass
class SoakResult:
    """What has become of the run; `memory_kb` are samples of the resident memory."""

    sent: int = 0
    recorded_is_complete: bool = False
    holes: int = 0
    clock_marks: int = 0
    torn_rows: int = 0
    rows: int = 0
    status: int = 0
    seconds_to_end: float = 0.0
    memory_kb: list[int] = field(default_factory=list)
    said: str = ""

    @property
    def growth_kb(self) -> int:
        """How much memory has grown in the last two thirds of the run."""
        return self.memory_kb[-1] - self.memory_kb[len(self.memory_kb) // 3]


class Soak:
    """One run in a folder of its own."""

    def __init__(self, folder: Path, seconds: float) -> None:
        self._folder, self._seconds = folder, seconds
        self._end = FarEnd(folder / "ttyA")
        self._broker = Mosquitto(folder)
        self._clock = folder / "clock"
        self._clock.write_text("0")
        self._sent = bytearray()
        self._said = bytearray()
        self._plugged = True

    def run(self) -> SoakResult:
        """Everything that happens, in its order."""
        self._broker.start()
        with self._tap() as tap:
            assert tap.stdout is not None
            assert tap.stderr is not None
            hearing = threading.Thread(target=self._hear, args=[tap.stderr])
            hearing.start()
            while b"recording to" not in self._said:
                time.sleep(0.05)
            result = SoakResult()
            self._poll(tap, result, self._events(tap))
            begun = time.monotonic()
            tap.send_signal(signal.SIGTERM)
            result.status = tap.wait(30)
            result.seconds_to_end = time.monotonic() - begun
            hearing.join()
        self._broker.stop()
        self._end.pull()
        result.said = self._said.decode()
        self._examine(result)
        return result

    def _tap(self) -> subprocess.Popen[bytes]:
        words = (
            sys.executable, "-m", "tests.faults.tap_with_clock", str(self._clock),
            "tap", f"soak={self._end.link}", "--line", "115200-8N1",
            "--record", self._folder / "raw.pcapng", "--rotate", "500kB",
            "-o", self._folder / "rows.jsonl", "--mqtt", f"mqtt://127.0.0.1:{self._broker.port}/x",
        )  # fmt: skip
        return subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT, env=environment(),
        )  # fmt: skip

    def _events(self, tap: subprocess.Popen[bytes]) -> list[tuple[float, Callable[[], None]]]:
        """What happens at which share of the run."""
        _, hard = resource.prlimit(tap.pid, resource.RLIMIT_FSIZE)

        def limit(size: int) -> None:
            resource.prlimit(tap.pid, resource.RLIMIT_FSIZE, (size, hard))

        def read_on() -> None:
            threading.Thread(target=self._read_away, args=[tap.stdout], daemon=True).start()

        def set_clock() -> None:
            self._clock.write_text(str(1000 * 86_400 * 10**9))

        return [
            (0.15, self._broker.stop),
            (0.30, self._broker.start),
            (0.35, lambda: limit(50)),
            (0.40, read_on),
            (0.45, self._pull),
            (0.48, self._plug),
            (0.50, lambda: limit(hard)),
            (0.55, set_clock),
            (0.85, self._pull),
            (0.88, self._plug),
        ]

    def _poll(
        self,
        tap: subprocess.Popen[bytes],
        result: SoakResult,
        events: list[tuple[float, Callable[[], None]]],
    ) -> None:
        """Send exchanges, and let the events happen."""
        begun = next_sample = time.monotonic()
        while (now := time.monotonic()) - begun < self._seconds:
            while events and now - begun >= events[0][0] * self._seconds:
                events.pop(0)[1]()
            if now >= next_sample:
                next_sample += self._seconds / 60
                status = Path(f"/proc/{tap.pid}/status").read_text(encoding="ascii")
                found = re.search(r"VmRSS:\s+(\d+)", status)
                result.memory_kb.append(int(found[1]) if found else 0)
            if self._plugged:
                os.write(self._end.far, PAIR)
                self._sent += PAIR
            time.sleep(PAUSE_S)
        time.sleep(1.0)

    def _pull(self) -> None:
        # What a pty still holds when it is closed is lost, which is not the tap's fault.
        time.sleep(0.5)
        self._end.pull()
        self._plugged = False

    def _plug(self) -> None:
        before = self._said.count(b"back after")
        self._end.plug()
        while self._said.count(b"back after") == before:
            time.sleep(0.05)
        self._plugged = True

    def _hear(self, errors: IO[bytes]) -> None:
        while block := os.read(errors.fileno(), 4096):
            self._said += block

    @staticmethod
    def _read_away(output: IO[bytes]) -> None:
        while os.read(output.fileno(), 4096):
            pass

    def _examine(self, result: SoakResult) -> None:
        """Compare the recording and the rows with what was sent."""
        recorded = bytearray()
        for segment in sorted(self._folder.glob("raw_*.pcapng")):
            data = segment.read_bytes()
            result.clock_marks += data.count(b"clock_step=")
            for _, _, payload, _ in packets(data):
                recorded += payload[RTAC_HEAD:]
                result.holes += payload[8] == HOLE
        result.sent = len(self._sent)
        result.recorded_is_complete = recorded == self._sent
        text = (self._folder / "rows.jsonl").read_text()
        result.torn_rows = not text.endswith("\n")
        for line in text.splitlines():
            json.loads(line)
            result.rows += 1


def main() -> int:
    """Run it, print what was found, and judge."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=600.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result = Soak(Path(folder), options.seconds).run()
    sys.stdout.write(
        f"{result.said}\n{result.sent:,} bytes sent, recording complete:"
        f" {result.recorded_is_complete}, {result.holes} holes and {result.clock_marks} steps of"
        f" the clock marked, {result.rows:,} rows, {result.torn_rows} torn; memory"
        f" {result.memory_kb[0]:,} to {result.memory_kb[-1]:,} kB, {result.growth_kb:,} kB in the"
        f" last two thirds; ended {result.seconds_to_end:.1f} s after SIGTERM, exit status"
        f" {result.status}\n"
    )
    return 0 if result.recorded_is_complete and not result.torn_rows else 1


if __name__ == "__main__":
    sys.exit(main())
