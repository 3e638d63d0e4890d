"""A sweep of all 65,536 registers: memory and time of what looks at every register.

Memory is that of a process; time is the processor's, and compared between two sizes.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dissectors.craft import craft
from tests.conftest import ROOT, command, environment

if sys.platform == "win32":
    pytest.skip("resource usage of POSIX", allow_module_level=True)

BLOCK = 125
PASSES = 4
SMALL, LARGE = 16_384, 65_536
MOST_MIB = 256
MOST_SECONDS = 10

MEASURE = """
import os, subprocess, sys
running = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, usage = os.wait4(running.pid, 0)
print(usage.ru_maxrss, usage.ru_utime + usage.ru_stime)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def usage(*words: str | Path) -> tuple[float, float]:
    """The peak memory of a run in MiB, and its seconds of processor time."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, *command(*words)],
        capture_output=True, env=environment(), cwd=ROOT, check=True, timeout=100,
    )  # fmt: skip
    size, seconds = done.stdout.split()
    return int(size) / (1 << 20 if sys.platform == "darwin" else 1024), float(seconds)


def sweep(path: Path, registers: int) -> Path:
    """Reads of all registers: a third is zero, the others move a little from pass to pass."""
    frames = []
    for turn in range(PASSES):
        for first in range(0, registers, BLOCK):
            count = min(BLOCK, registers - first)
            values = [(at * 7 + turn * (at % 5)) % 65_536 if at % 3 else 0 for at in range(count)]
            frames.append(craft(3, unit=1, values={"address": first, "quantity": count}))
            frames.append(craft(3, unit=1, direction="response", values={"registers": values}))
    path.write_bytes(b"".join(frames))
    return path


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A quarter of all registers, and all."""
    folder = tmp_path_factory.mktemp("sweeps")
    return sweep(folder / "small.bin", SMALL), sweep(folder / "large.bin", LARGE)


@pytest.mark.parametrize("name", ["map", "learn", "match"])
def test_a_sweep_is_bounded(name: str, sweeps: tuple[Path, Path]) -> None:
    """Four times the registers take at most five times as long; the whole stays small."""
    small, large = (usage(name, path) for path in sweeps)
    assert large[0] < MOST_MIB
    assert large[1] < MOST_SECONDS
    # Starting takes the same time for both.
    assert large[1] < 5 * small[1]
    assert large[0] - small[0] < 4 * small[0]
