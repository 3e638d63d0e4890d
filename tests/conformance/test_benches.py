"""Every program of `bench/` says what it does when it is asked."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).parents[2] / "bench"
PROGRAMS = sorted(path.stem for path in BENCH.glob("*.py") if path.stem != "__init__")


@pytest.mark.parametrize("name", PROGRAMS)
def test_help(name: str) -> None:
    """Without a traceback, and without beginning to measure."""
    words = [sys.executable, "-m", f"bench.{name}", "--help"]
    done = subprocess.run(
        words, cwd=BENCH.parent, capture_output=True, text=True, timeout=30, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage:")
