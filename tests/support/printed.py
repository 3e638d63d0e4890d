"""Runs a command on a terminal and returns what it prints."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import subprocess
import termios
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

__all__ = ["printed"]

TIMEOUT_S = 60


def printed(  # noqa: PLR0913 - a terminal has a size
    words: Sequence[str],
    env: Mapping[str, str],
    *,
    cwd: Path,
    lines: int,
    columns: int,
    watch: Callable[[bytes, subprocess.Popen[bytes]], None] | None = None,
) -> tuple[str, int]:
    """Returns what a terminal of that size shows of a command, and the exit status.

    `watch` gets all that was shown so far after each read, and the process, for example to end it.
    """
    control, screen = pty.openpty()
    fcntl.ioctl(screen, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
    running = subprocess.Popen(words, cwd=cwd, env=env, stdout=screen, stderr=screen)
    os.close(screen)
    shown = b""
    try:
        while data := os.read(control, 1 << 16):
            shown += data
            if watch is not None:
                watch(shown, running)
    except OSError:  # Linux reports so that the other end is closed
        pass
    os.close(control)
    return shown.decode().replace("\r\n", "\n"), running.wait(TIMEOUT_S)
