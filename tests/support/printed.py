"""What a command prints on a terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import subprocess
import termios
from collections.abc import Mapping, Sequence
from pathlib import Path

__all__ = ["printed"]

TIMEOUT_S = 60


def printed(
    words: Sequence[str], env: Mapping[str, str], *, cwd: Path, lines: int, columns: int
) -> tuple[str, int]:
    """What a terminal of that size gets of a command, output and messages alike; its status."""
    control, screen = pty.openpty()
    fcntl.ioctl(screen, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
    running = subprocess.Popen(words, cwd=cwd, env=env, stdout=screen, stderr=screen)
    os.close(screen)
    shown = b""
    try:
        while data := os.read(control, 1 << 16):
            shown += data
    except OSError:  # how Linux says that nobody is left at the other end
        pass
    os.close(control)
    return shown.decode().replace("\r\n", "\n"), running.wait(TIMEOUT_S)
