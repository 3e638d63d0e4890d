"""Simulates a serial port with polling on it, for pictures: a pty that obeys the rate it is set to.

A receiver with another rate or parity than the line gets what a UART would make of the bits, so a
tap has to find the settings as on a real line.
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import termios
import threading
import tty
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Self

from analyzer.line import parse_line
from tests.support.uart import Uart, Wire

__all__ = ["SimulatedPort"]

RATES = {
    getattr(termios, f"B{rate}"): rate
    for rate in (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
}
PAUSE_S, TIMEOUT_S = 0.05, 0.2
"""Between frames, and after a request that is not answered."""


class SimulatedPort:
    """Repeats the frames of a recording on a pty; `name` is the port to tap."""

    def __init__(self, frames: Path, line: str) -> None:
        self._line = parse_line(line)
        self._frames = [json.loads(text) for text in frames.read_text("utf-8").splitlines()]
        self._far, self._near = pty.openpty()
        tty.setraw(self._near)
        os.set_blocking(self._far, False)
        self.name = os.ttyname(self._near)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._near)
        os.close(self._far)

    def _run(self) -> None:
        for data, pause_s in self._traffic():
            wire = Wire(self._line)
            wire.send(data, 0.0)
            rate = RATES.get(termios.tcgetattr(self._near)[4], 9600)
            heard = Uart(replace(self._line, baud=rate)).receive(wire, 0.0)
            with contextlib.suppress(BlockingIOError):  # Nobody reads yet.
                os.write(self._far, bytes(one.byte for one in heard))
            if self._stop.wait(pause_s):
                return

    def _traffic(self) -> Iterator[tuple[bytes, float]]:
        """Yields frames, each with the pause after it, again and again."""
        while True:
            for frame, following in zip(
                self._frames, [*self._frames[1:], self._frames[0]], strict=True
            ):
                unanswered = frame["direction"] == following["direction"] == "request"
                yield bytes.fromhex(frame["hex"]), TIMEOUT_S if unanswered else PAUSE_S
