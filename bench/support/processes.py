"""CPU seconds and memory of whole processes."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence

__all__ = ["measured"]


def measured(
    command: Sequence[str], environment: Mapping[str, str] | None = None
) -> tuple[float, float]:
    """CPU seconds and peak MiB of a child process; the peak is not below that of this process."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, stdout=quiet, stderr=quiet, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if status:
        raise SystemExit(f"{' '.join(command)} failed: {process.returncode}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
