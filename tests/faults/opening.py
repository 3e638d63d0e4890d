"""What the other side of a line sees of a tap that opens its port; `make openings` takes 1,000.

    python -m tests.faults.opening --times 1000 [--slow-us 1000]

The port is a pseudo terminal in the kernel's default state, with echo: what arrives before the tap
has set it raw is sent back. Bytes arrive without a pause from the moment of `open` on (inotify(7)).
With `--slow-us`, each ioctl of the tap is delayed by that time, as a USB control transfer is.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from pathlib import Path

from tests.conftest import ROOT, environment

IN_OPEN = 0x20
WATCHED_S = 0.05
"""For so long bytes arrive after the port was opened."""

PATIENCE_S = 30.0
GATEWAY = ROOT / "target" / "release" / "modlens-tap"
TAPS = {
    "modlens tap": (sys.executable, "-m", "analyzer", "tap"),
    "modlens-tap": (str(GATEWAY),),
}
OPENER = "import sys, _modlens; _modlens.Tty(sys.argv[1], '19200-8E1'); sys.stdin.read()"
"""The opening alone, which is the same code in both taps."""


def build_gateway() -> None:
    """Build the tap for gateways, as `cargo test` leaves it."""
    words = ["cargo", "build", "--release", "--locked", "--workspace", "--bin", GATEWAY.name]
    subprocess.run(words, cwd=ROOT, check=True, timeout=900, capture_output=True)


class Openings:
    """Watches a port for being opened."""

    def __init__(self, name: str) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        self._fd = libc.inotify_init1(os.O_NONBLOCK)
        if self._fd < 0 or libc.inotify_add_watch(self._fd, name.encode(), IN_OPEN) < 0:
            raise OSError(ctypes.get_errno(), "inotify")

    def wait(self) -> None:
        """Wait for the next one."""
        if not select.select([self._fd], [], [], PATIENCE_S)[0]:
            raise TimeoutError("the port was not opened")
        os.read(self._fd, 4096)

    def close(self) -> None:
        """Stop watching."""
        os.close(self._fd)


def echoed(words: Sequence[str], slow_us: int = 0, trace: Path | None = None) -> int:
    """Let a tap open a port in default state; gives the bytes that came back.

    `words` are the command before the port's name.
    """
    far, near = pty.openpty()
    name = os.ttyname(near)
    os.set_blocking(far, False)
    assert termios.tcgetattr(near)[3] & termios.ECHO, "not the default state"
    openings = Openings(name)
    if slow_us:
        delay = f"inject=ioctl:delay_enter={slow_us}"
        words = ("strace", "-f", "-qq", "-o", os.devnull, "-e", "trace=ioctl", "-e", delay, *words)
    elif trace is not None:
        calls = "trace=open,openat,flock,ioctl,write,sendto"
        words = ("strace", "-f", "-y", "-qq", "-o", str(trace), "-e", calls, *words)
    tap = subprocess.Popen(
        [*words, name, *(["--line", "19200-8E1"] if "tap" in words[-1] else [])],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        env=environment(), cwd=ROOT, start_new_session=True,
    )  # fmt: skip
    try:
        openings.wait()
        came_back = 0
        until = time.monotonic() + WATCHED_S + 20 * slow_us / 1e6
        while time.monotonic() < until:
            _write(far)
            came_back += _read(far)
        time.sleep(WATCHED_S)
        return came_back + _read(far)
    finally:
        os.killpg(tap.pid, signal.SIGKILL)  # strace would pass no signal on
        tap.communicate()
        openings.close()
        os.close(far)
        os.close(near)


def _write(far: int) -> None:
    try:
        os.write(far, b"U")
    except BlockingIOError:
        time.sleep(0.001)


def _read(far: int) -> int:
    try:
        return len(os.read(far, 4096))
    except OSError:
        return 0


def main() -> None:
    """Count openings after which something came back."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--times", type=int, default=1000)
    parser.add_argument("--slow-us", type=int, default=0)
    options = parser.parse_args()
    found = [echoed((sys.executable, "-c", OPENER), options.slow_us) for _ in range(options.times)]
    hit = [count for count in found if count]
    slow = f", each ioctl slowed by {options.slow_us} us" if options.slow_us else ""
    sys.stdout.write(
        f"{options.times} openings{slow}: {len(hit)} with echo, at most {max(found)} bytes,"
        f" {sum(found)} in all\n"
    )


if __name__ == "__main__":
    main()
