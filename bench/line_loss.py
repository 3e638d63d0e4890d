"""A fast line on a busy machine into both taps: what the kernel refused, and what a tap lost.

    python -m bench.line_loss --seconds 600 --baud 3000000

Each tap has a pseudo terminal of its own and records what it reads. The line never waits: bytes
that the kernel does not take at once are gone, as in a receiver that overruns, and are counted as
refused. All bytes that it took have to be in the recording, in their order. Beside them as many
processes as there are cores compute without a pause. Linux only.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import multiprocessing
import os
import pty
import signal
import subprocess
import sys
import tempfile
import time
import tty
from dataclasses import dataclass
from pathlib import Path

from bench.tap_load import cpu_s, traffic
from tests.conftest import ROOT, environment
from tests.faults.opening import GATEWAY, TAPS, build_gateway
from tests.support.raw_recording import RTAC_HEAD, packets

__all__ = ["Loss", "run"]

TICK_S = 0.001
CHAR_BITS = 10
SETTLED_S = 1.0
PATIENCE_S = 60.0
FIFO_PRIORITY = 2
"""Above that of the taps' readers: a line waits for nobody."""


@dataclass(slots=True)
class Loss:
    """What became of one tap's bytes; `digest` is that of the bytes in their order."""

    name: str
    accepted: int = 0
    refused: int = 0
    recorded: int = 0
    is_same: bool = False
    cpu: float = 0.0
    said: str = ""


class Listener:
    """A tap that records what its pseudo terminal delivers."""

    def __init__(self, name: str, words: tuple[str, ...], baud: int, folder: Path) -> None:
        """Start it, and wait until it listens."""
        self.loss = Loss(name)
        self._folder = folder / name.replace(" ", "_")
        self._folder.mkdir()
        self._far, self._near = pty.openpty()
        tty.setraw(self._near)
        os.set_blocking(self._far, False)
        self._digest = hashlib.sha256()
        self._messages = self._folder / "messages"
        recording = str(self._folder / "raw.pcapng")
        self._tap = subprocess.Popen(
            [*words, os.ttyname(self._near), "--line", f"{baud}-8N1", "--record", recording,
             "--rotate", "16MB"],
            stdout=subprocess.DEVNULL, stderr=self._messages.open("w"), env=environment(), cwd=ROOT,
        )  # fmt: skip
        until = time.monotonic() + PATIENCE_S
        while "recording to" not in self._messages.read_text():
            assert self._tap.poll() is None, self._messages.read_text()
            assert time.monotonic() < until
            time.sleep(0.05)
        self._idle = cpu_s(self._tap.pid)

    def send(self, data: bytes) -> None:
        """What the line sends now; the kernel takes as much as it can."""
        taken = 0
        with contextlib.suppress(BlockingIOError):
            taken = os.write(self._far, data)
        self._digest.update(data[:taken])
        self.loss.accepted += taken
        self.loss.refused += len(data) - taken

    def stop(self, seconds: float) -> Loss:
        """End the tap, and compare its recording with what the kernel took."""
        self.loss.cpu = (cpu_s(self._tap.pid) - self._idle) / seconds
        self._tap.send_signal(signal.SIGTERM)
        self._tap.wait(PATIENCE_S)
        os.close(self._far)
        os.close(self._near)
        heard = hashlib.sha256()
        for segment in sorted(self._folder.glob("raw_*.pcapng")):
            for _, _, payload, _ in packets(segment.read_bytes()):
                heard.update(payload[RTAC_HEAD:])
                self.loss.recorded += len(payload) - RTAC_HEAD
        self.loss.is_same = heard.digest() == self._digest.digest()
        self.loss.said = self._messages.read_text()
        return self.loss


def run(seconds: float, baud: int, busy: int) -> list[Loss]:
    """Both taps on a line each, for so long."""
    others = [multiprocessing.Process(target=_compute, daemon=True) for _ in range(busy)]
    with tempfile.TemporaryDirectory() as folder:
        taps = [Listener(name, words, baud, Path(folder)) for name, words in TAPS.items()]
        for other in others:
            other.start()
        # Without the right to do so it is only a line that may hesitate.
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
        _send(taps, seconds, baud)
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        time.sleep(SETTLED_S)
        for other in others:
            other.kill()
        return [tap.stop(seconds) for tap in taps]


def _compute() -> None:
    while True:
        hashlib.sha256(bytes(1 << 16)).digest()


def _send(taps: list[Listener], seconds: float, baud: int) -> None:
    """Frames without a pause at the line's pace, handed over each millisecond."""
    stream = b"".join(traffic())
    sent, rate = 0, baud / CHAR_BITS
    doubled = stream * (2 + int(rate) // len(stream))
    start = time.monotonic()
    while (now := time.monotonic()) - start < seconds:
        due = min(int((now - start) * rate) - sent, int(rate))
        at = sent % len(stream)
        for tap in taps:
            tap.send(doubled[at : at + due])
        sent += due
        time.sleep(TICK_S)


def main() -> int:
    """Run the bench and print its results."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--baud", type=int, default=3_000_000)
    parser.add_argument("--busy", type=int, default=os.cpu_count(), help="processes that compute")
    options = parser.parse_args()
    if not GATEWAY.exists():
        build_gateway()
    losses = run(options.seconds, options.baud, options.busy)
    out = sys.stdout.write
    out(f"{options.baud:,} baud for {options.seconds:.0f} s, {options.busy} processes compute\n")
    for loss in losses:
        sent = loss.accepted + loss.refused
        lost = loss.accepted - loss.recorded
        out(f"{loss.name}: sent {sent:,} bytes; the kernel refused {loss.refused:,}")
        out(
            f" ({loss.refused / sent:.3%}); of the {loss.accepted:,} that it took, {lost:,} are not"
        )
        out(f" in the recording, which is {'the same' if loss.is_same else 'NOT the same'};")
        out(f" CPU {loss.cpu:.0%} of a core\n")
    return 0 if all(loss.is_same for loss in losses) else 1


if __name__ == "__main__":
    sys.exit(main())
