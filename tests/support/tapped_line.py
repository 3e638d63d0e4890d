"""A tap as a process of its own on a pseudo terminal, with traffic that the test sends."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import threading
import time
import tty
from pathlib import Path
from typing import IO, Any, Self

from tests.conftest import ROOT, command, environment

REQUEST, RESPONSE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
PAIR = REQUEST + RESPONSE


class TappedLine:
    """A tap of `port`, which is the near end of a pty; `words` are further options.

    `start` waits until it listens. What it says is in `said` after `end`. With `two_lines` the tap
    has a port for each direction, and `send` puts requests on `far` and responses on `far_b`.
    """

    def __init__(
        self, *words: str | Path, line: str = "115200-8N1", two_lines: bool = False
    ) -> None:
        self._ends = [pty.openpty() for _ in range(1 + two_lines)]
        self.far, self.far_b = self._ends[0][0], self._ends[-1][0]
        for _, near in self._ends:
            tty.setraw(near)
        self.port = "+".join(os.ttyname(near) for _, near in self._ends)
        self.sent = bytearray()
        self.said = ""
        self._said = bytearray()
        self._words = command("tap", self.port, "--line", line, *words)
        self._process: subprocess.Popen[bytes] | None = None
        self._reader: threading.Thread | None = None

    def start(self, stdout: int = subprocess.DEVNULL, **more: Any) -> subprocess.Popen[bytes]:
        """Start it; `more` are arguments of `Popen`."""
        more.setdefault("env", environment())
        more.setdefault("stderr", subprocess.PIPE)
        self._process = subprocess.Popen(self._words, stdout=stdout, cwd=ROOT, **more)
        if self._process.stderr is not None:
            self._reader = threading.Thread(target=self._read, args=[self._process.stderr])
            self._reader.start()
        return self._process

    def _read(self, errors: IO[bytes]) -> None:
        with errors:
            while block := os.read(errors.fileno(), 4096):
                self._said += block

    def wait_for(self, word: str, timeout: float = 30.0) -> None:
        """Wait until it has said this on standard error."""
        until = time.monotonic() + timeout
        while word not in self.saying():
            assert time.monotonic() < until, f"{word!r} did not come: {self.saying()}"
            time.sleep(0.02)

    def saying(self) -> str:
        """What it has said on standard error so far."""
        return self._said.decode()

    def send(self, seconds: float, pairs: int = 10, pause_s: float = 0.013) -> None:
        """Poll for so long: exchanges, then a pause."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.sent += PAIR * pairs
            if self.far == self.far_b:
                os.write(self.far, PAIR * pairs)
            else:
                for _ in range(pairs):
                    os.write(self.far, REQUEST)
                    time.sleep(pause_s / pairs)
                    os.write(self.far_b, RESPONSE)
            time.sleep(pause_s)

    def end(self, timeout: float = 20.0, number: int = signal.SIGTERM) -> float:
        """Send one signal and wait; gives how long it took."""
        assert self._process is not None
        begun = time.monotonic()
        self._process.send_signal(number)
        self._process.wait(timeout)
        took = time.monotonic() - begun
        if self._reader is not None:
            self._reader.join()
        self.said = self.saying()
        return took

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing of it is left running."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        for end in (end for ends in self._ends for end in ends):
            os.close(end)
