"""Runs `modlens` in a process of its own and measures what it takes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import ROOT, command, environment

__all__ = ["Measured", "measured"]

_LAUNCHER = """
import json, os, sys
child = os.posix_spawn(sys.argv[2], sys.argv[2:], os.environ)
_, status, used = os.wait4(child, 0)
cpu_s = used.ru_utime + used.ru_stime
with open(sys.argv[1], "w") as file:
    json.dump([os.waitstatus_to_exitcode(status), used.ru_maxrss / 1024, cpu_s], file)
"""
"""The peak of a child is never below the size of the process that began it: so not the tests'."""


@dataclass(frozen=True)
class Measured:
    """A finished run: exit status, output, messages, and what it took."""

    status: int
    out: bytes
    err: str
    peak_mib: float
    cpu_s: float


def measured(*words: str | Path) -> Measured:
    """Run the command to its end."""
    with tempfile.NamedTemporaryFile() as usage:
        launched = [sys.executable, "-I", "-S", "-c", _LAUNCHER, usage.name, *command(*words)]
        done = subprocess.run(
            launched, stdin=subprocess.DEVNULL, capture_output=True, check=True,
            env=environment(), cwd=ROOT,
        )  # fmt: skip
        status, peak_mib, cpu_s = json.loads(Path(usage.name).read_text())
    said = done.stderr.decode()
    assert "Traceback" not in said
    return Measured(status, done.stdout, said, peak_mib, cpu_s)
