"""A real ESPHome between a line and a tap: `make esphome MINUTES=30`.

    python -m tests.support.esphome_host --minutes 30

The firmware is ESPHome's own, for its platform `host`. ESPHome generates the sources, and the C++
compiler builds them here, because PlatformIO would fetch a package from its own registry. The line
is a pty bus that another tap reads directly; the firmware is killed and started again three times.
Prints what the rows of the two taps have in common.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.support.ptybus import PtyBus
from tests.support.side_by_side import MASTER, UNIT, WHOLE, Heard, differences, poll

LINE = Path("/tmp") / f"modlens-esphome-{os.getpid()}"
"""A link to the pty: ESPHome takes paths of two parts only."""
PORT = 16_053
RECONNECTS = 3
SHOWN = 50
CONFIGURATION = f"""
esphome:
  name: meter
host:
api:
  port: {PORT}
logger:
uart:
  - id: bus
    port: {LINE}
    baud_rate: 19200
serial_proxy:
  - name: meter
    uart_id: bus
    port_type: RS485
"""
FLAGS = (
    "-O1 -std=gnu++20 -fno-exceptions -w -Isrc"
    " -DUSE_HOST -DESPHOME_LOG_LEVEL=ESPHOME_LOG_LEVEL_DEBUG"
)


def build(esphome: str, folder: Path) -> Path:
    """The firmware as a program of this machine; half a minute of CPU."""
    (folder / "host.yaml").write_text(CONFIGURATION)
    words = [esphome, "compile", "--only-generate", "host.yaml"]
    subprocess.run(words, cwd=folder, check=True, capture_output=True)
    (made,) = folder.glob(".esphome/build/*/src")

    def compiled(source: Path) -> str:
        target = str(source.with_suffix(".o"))
        words = ["g++", *FLAGS.split(), "-c", str(source), "-o", target]
        subprocess.run(words, cwd=made.parent, check=True)
        return target

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        objects = list(pool.map(compiled, sorted(made.rglob("*.cpp"))))
    program = folder / "firmware"
    subprocess.run(["g++", *objects, "-o", str(program), "-lpthread"], check=True)
    return program


class Firmware:
    """The running firmware; `restart` is what a loss of power is to a device."""

    def __init__(self, program: Path, folder: Path) -> None:
        self._program, self._folder = program, folder
        self._running = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        with (self._folder / "firmware.log").open("ab") as log:
            return subprocess.Popen([self._program], cwd=self._folder, stdout=log, stderr=log)

    def restart(self) -> None:
        """Kill it, and start it again."""
        self.close()
        self._running = self._start()

    def close(self) -> None:
        """Kill it."""
        self._running.kill()
        self._running.wait()


@contextlib.contextmanager
def running(program: Path, folder: Path) -> Iterator[Firmware]:
    """The firmware, once its API answers."""
    firmware = Firmware(program, folder)
    try:
        end = time.monotonic() + 20
        while True:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", PORT)) == 0:
                    break
            if time.monotonic() > end:
                raise SystemExit(f"no API: {(folder / 'firmware.log').read_text()[-2000:]}")
            time.sleep(0.1)
        yield firmware
    finally:
        firmware.close()


def compare(program: Path, folder: Path, seconds: float) -> bool:
    """Play traffic, print what both taps heard; whether it is the same but for the reconnects."""
    due = [seconds * (one + 1) / (RECONNECTS + 1) for one in range(RECONNECTS)]
    with (
        PtyBus([MASTER, UNIT, "tap", "proxy"], 19200, 10, trigger=WHOLE) as bus,
        contextlib.ExitStack() as opened,
    ):
        LINE.symlink_to(bus.path("proxy"))
        opened.callback(LINE.unlink)
        firmware = opened.enter_context(running(program, folder))
        direct = opened.enter_context(Heard(f"{bus.path('tap')}@19200-8N1"))
        other = opened.enter_context(Heard(f"esphome://127.0.0.1:{PORT}/meter@19200-8N1"))

        def restart_when_due(at: float) -> None:
            if due and at > due[0]:
                due.pop(0)
                firmware.restart()

        count = poll(bus, seconds=seconds, between=restart_when_due)
        time.sleep(3.0)
        written = sum(len(sent.written) for sent in bus.truth if sent.sender == "proxy")
    found = differences(direct.rows, other.rows)
    halves = {row[-1] for row in found.extra} - {"unsolicited", "not_observed", "no_response"}
    sys.stdout.write(
        f"{count} exchanges in {seconds:.0f} s; rows: {len(direct.rows)} of the line,"
        f" {len(other.rows)} through ESPHome, in order: {found.is_in_order}\n"
        f"connected again {other.returned()} times; holes {found.holes}, rows missing in them"
        f" {len(found.missing)}, rows of half an exchange {len(found.extra)}\n"
        f"bytes that ESPHome wrote to the line: {written}\n"
        + "".join(f"only on the line: {row}\n" for row in found.missing[:SHOWN])
        + "".join(f"only through ESPHome: {row}\n" for row in found.extra[:SHOWN])
    )
    return (
        found.is_in_order
        and other.returned() == RECONNECTS
        and found.holes <= RECONNECTS
        and len(found.extra) <= 2 * RECONNECTS
        and not halves
        and not written
        and len(direct.rows) == count
    )


def main() -> int:
    """Build, play, compare; gives the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--esphome", default="esphome", help="ESPHome's command")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        program = build(os.path.abspath(options.esphome), Path(place))
        return 0 if compare(program, Path(place), options.minutes * 60) else 1


if __name__ == "__main__":
    sys.exit(main())
