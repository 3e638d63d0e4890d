"""Seconds and memory of whole processes."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Mapping, Sequence

__all__ = ["measured", "side_by_side", "timed"]


def measured(
    command: Sequence[str], environment: Mapping[str, str] | None = None
) -> tuple[float, float]:
    """CPU seconds and peak MiB of a child process; the peak is not below that of this process."""
    return timed(command, environment)[1:]


def timed(
    command: Sequence[str], environment: Mapping[str, str] | None = None
) -> tuple[float, float, float]:
    """The same with the wall-clock seconds that it takes."""
    quiet = subprocess.DEVNULL
    begun = time.monotonic()
    process = subprocess.Popen(command, stdout=quiet, stderr=quiet, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.monotonic() - begun
    process.returncode = os.waitstatus_to_exitcode(status)
    if status:
        raise SystemExit(f"{' '.join(command)} failed: {process.returncode}")
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def side_by_side(commands: Sequence[Sequence[str]]) -> float:
    """The seconds of wall until all of these, begun together, have ended."""
    quiet = subprocess.DEVNULL
    begun = time.monotonic()
    running = [subprocess.Popen(command, stdout=quiet, stderr=quiet) for command in commands]
    for command, process in zip(commands, running, strict=True):
        if process.wait():
            raise SystemExit(f"{' '.join(command)} failed: {process.returncode}")
    return time.monotonic() - begun
