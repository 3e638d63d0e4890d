"""Both taps with everything against them at once; `make soak` takes ten minutes.

    python -m tests.faults.soak --seconds 600

`modlens tap` and `modlens-tap` hear the same line, each at a port of its own; it is polled fifty
times a second. Meanwhile nobody reads their standard output, the broker goes away and comes back,
the disk is full for a while, the ports are unplugged twice, and somebody sets the clock forward by
years (that of `modlens tap`; the other one has no place to do that). In the end both raw
recordings have every byte that was sent, the holes are marked, the rows are whole, memory has not
grown, and one signal was enough.
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
from tests.faults.opening import GATEWAY, build_gateway
from tests.support.far_end import FarEnd
from tests.support.raw_recording import RTAC_HEAD, packets

PAIR = bytes.fromhex("010300000001840a0103020007f986")
PAUSE_S = 0.02
HOLE = 6
"""The event of a hole in a raw recording."""


@dataclass
class SoakResult:
    """What has become of one tap; `memory_kb` are samples of the resident memory."""

    name: str
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


class TapUnderTest:
    """One tap with its port, in a folder of its own."""

    def __init__(self, name: str, folder: Path, program: list[str], broker: int) -> None:
        """Start it, and wait until it records."""
        folder.mkdir()
        self.result = SoakResult(name)
        self._folder = folder
        self._end = FarEnd(folder / "ttyA")
        self._sent, self._said = bytearray(), bytearray()
        self._plugged = True
        self._reading: threading.Thread | None = None
        words = [
            *program, f"soak={self._end.link}", "--line", "115200-8N1",
            "--record", str(folder / "raw.pcapng"), "--rotate", "500kB",
            "-o", str(folder / "rows.jsonl"), "--mqtt", f"mqtt://127.0.0.1:{broker}/{name}",
        ]  # fmt: skip
        self._tap = subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT, env=environment(),
        )  # fmt: skip
        assert self._tap.stdout is not None
        assert self._tap.stderr is not None
        self._rows = self._tap.stdout
        self._hearing = threading.Thread(target=self._hear, args=[self._tap.stderr])
        self._hearing.start()
        _, self._no_limit = resource.prlimit(self._tap.pid, resource.RLIMIT_FSIZE)
        while b"recording to" not in self._said:
            assert self._tap.poll() is None, self._said
            time.sleep(0.05)

    def send(self) -> None:
        """An exchange, unless the port is unplugged."""
        if self._plugged:
            os.write(self._end.far, PAIR)
            self._sent += PAIR

    def sample(self) -> None:
        """Note the memory."""
        status = Path(f"/proc/{self._tap.pid}/status").read_text(encoding="ascii")
        found = re.search(r"VmRSS:\s+(\d+)", status)
        self.result.memory_kb.append(int(found[1]) if found else 0)

    def limit_files(self, size: int | None) -> None:
        """The disk is full for this tap, or no more."""
        limit = self._no_limit if size is None else size
        resource.prlimit(self._tap.pid, resource.RLIMIT_FSIZE, (limit, self._no_limit))

    def read_on(self) -> None:
        """Somebody reads standard output from now on."""
        self._reading = threading.Thread(target=self._read_away, daemon=True)
        self._reading.start()

    def pull(self) -> None:
        """Unplug the port. What a pty still holds is lost then, which is not the tap's fault."""
        time.sleep(0.5)
        self._end.pull()
        self._plugged = False

    def plug(self) -> None:
        """Plug it in, and wait until the tap is back."""
        before = self._said.count(b"back after")
        self._end.plug()
        while self._said.count(b"back after") == before:
            time.sleep(0.05)
        self._plugged = True

    def stop(self) -> SoakResult:
        """One signal; then compare the recording and the rows with what was sent."""
        begun = time.monotonic()
        self._tap.send_signal(signal.SIGTERM)
        self.result.status = self._tap.wait(30)
        self.result.seconds_to_end = time.monotonic() - begun
        self._hearing.join()
        if self._reading:
            self._reading.join()
        self._end.pull()
        self.result.said = self._said.decode()
        self._examine()
        return self.result

    def _hear(self, errors: IO[bytes]) -> None:
        with errors:
            while block := os.read(errors.fileno(), 4096):
                self._said += block

    def _read_away(self) -> None:
        with self._rows:
            while os.read(self._rows.fileno(), 4096):
                pass

    def _examine(self) -> None:
        result, recorded = self.result, bytearray()
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


class Soak:
    """One run in a folder of its own."""

    def __init__(self, folder: Path, seconds: float) -> None:
        """Nothing runs yet."""
        self._folder, self._seconds = folder, seconds
        self._broker = Mosquitto(folder)
        self._clock = folder / "clock"
        self._clock.write_text("0")

    def run(self) -> list[SoakResult]:
        """Everything that happens, in its order; the results of both taps."""
        self._broker.start()
        python = [sys.executable, "-m", "tests.faults.tap_with_clock", str(self._clock), "tap"]
        programs = {"modlens": python, "modlens-tap": [str(GATEWAY)]}
        taps = [
            TapUnderTest(name, self._folder / name, program, self._broker.port)
            for name, program in programs.items()
        ]
        self._poll(taps, self._events(taps))
        results = [tap.stop() for tap in taps]
        self._broker.stop()
        return results

    def _events(self, taps: list[TapUnderTest]) -> list[tuple[float, Callable[[], None]]]:
        """What happens at which share of the run."""

        def each(act: Callable[[TapUnderTest], None]) -> Callable[[], None]:
            def all_of_them() -> None:
                for tap in taps:
                    act(tap)

            return all_of_them

        def set_clock() -> None:
            self._clock.write_text(str(1000 * 86_400 * 10**9))

        return [
            (0.15, self._broker.stop),
            (0.30, self._broker.start),
            (0.35, each(lambda tap: tap.limit_files(50))),
            (0.40, each(TapUnderTest.read_on)),
            (0.45, each(TapUnderTest.pull)),
            (0.48, each(TapUnderTest.plug)),
            (0.50, each(lambda tap: tap.limit_files(None))),
            (0.55, set_clock),
            (0.85, each(TapUnderTest.pull)),
            (0.88, each(TapUnderTest.plug)),
        ]

    def _poll(
        self, taps: list[TapUnderTest], events: list[tuple[float, Callable[[], None]]]
    ) -> None:
        """Send exchanges, and let the events happen."""
        begun = next_sample = time.monotonic()
        while (now := time.monotonic()) - begun < self._seconds:
            while events and now - begun >= events[0][0] * self._seconds:
                events.pop(0)[1]()
            is_due = now >= next_sample
            next_sample += is_due * self._seconds / 60
            for tap in taps:
                if is_due:
                    tap.sample()
                tap.send()
            time.sleep(PAUSE_S)
        time.sleep(1.0)


def main() -> int:
    """Run it, print what was found, and judge."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=600.0)
    options = parser.parse_args()
    build_gateway()
    with tempfile.TemporaryDirectory() as folder:
        results = Soak(Path(folder), options.seconds).run()
    for result in results:
        sys.stdout.write(
            f"{result.said}\n{result.name}: {result.sent:,} bytes sent, recording complete:"
            f" {result.recorded_is_complete}, {result.holes} holes and {result.clock_marks} steps"
            f" of the clock marked, {result.rows:,} rows, {result.torn_rows} torn; memory"
            f" {result.memory_kb[0]:,} to {result.memory_kb[-1]:,} kB, {result.growth_kb:,} kB in"
            f" the last two thirds; ended {result.seconds_to_end:.1f} s after SIGTERM, exit status"
            f" {result.status}\n"
        )
    is_right = all(result.recorded_is_complete and not result.torn_rows for result in results)
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main())
