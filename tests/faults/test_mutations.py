"""A part of the mutation bar: `make mutations` runs ten thousand cases."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT, environment
from tests.faults.mutants import case


@pytest.mark.skipif(not hasattr(os, "fork"), reason="cases are forks of a process")
def test_five_hundred_damaged_recordings() -> None:
    """Status 0 to 4, no traceback, no panic, bytes in are bytes out, 10 s and 256 MiB a case."""
    words = [sys.executable, "-m", "tests.faults.mutation_bar", "--cases", "500"]
    done = subprocess.run(
        words, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_cases_can_be_made_again() -> None:
    assert case(1, 7) == case(1, 7)
    assert len({case(1, number).data for number in range(50)}) > 40
