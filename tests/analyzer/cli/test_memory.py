"""Memory does not grow with the recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dissectors.craft import craft
from tests.conftest import ROOT, command, environment

if sys.platform == "win32":
    pytest.skip("resource usage of POSIX", allow_module_level=True)

MIB = 1 << 20


MEASURE = """
import os, subprocess, sys
running = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, usage = os.wait4(running.pid, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""
"""A small process that starts the command: Linux counts the memory of whoever starts it as well."""


def peak_kib(*words: str | Path) -> int:
    """The most memory that a run of the command has had at once."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, *command(*words)],
        capture_output=True,
        env=environment(),
        cwd=ROOT,
        check=True,
        timeout=60,
    )
    return int(done.stdout) // (1024 if sys.platform == "darwin" else 1)


@pytest.mark.parametrize("to", ["csv", "jsonl", "pcapng"])
def test_memory_is_the_same_for_a_longer_recording(to: str, tmp_path: Path) -> None:
    """A recording six times as long needs at most 3 MiB more with one thread.

    With two, what waits between them depends on which of them the system lets run, so that there is
    a bound for all of it.
    """
    registers = list(range(40))
    polls = b"".join(
        craft(3, unit=unit, values={"address": unit * 100, "quantity": 40})
        + craft(3, unit=unit, direction="response", values={"registers": registers})
        for unit in range(1, 20)
    )
    sizes = []
    for mib in (8, 48):
        path = tmp_path / f"{mib}.bin"
        path.write_bytes(polls * (mib * MIB // len(polls)))
        sizes.append(peak_kib("export", path, "--to", to, "--threads", "1"))
    assert sizes[1] - sizes[0] < 3 * 1024
    assert peak_kib("export", path, "--to", to, "--threads", "2") < 64 * 1024
