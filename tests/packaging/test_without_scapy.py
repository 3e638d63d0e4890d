"""Everything but scapy's own layers works where scapy is not installed."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.conftest import CAPTURES, ROOT, TIMEOUT_S, environment

WITHOUT = """
import sys
sys.modules["scapy"] = None
from analyzer.cli import main
sys.exit(main(sys.argv[1:]))
"""
RECORDING = str(CAPTURES / "pymodbus_disturbed" / "recording.jsonl")


@pytest.mark.parametrize(
    "words",
    [
        ("decode", RECORDING),
        ("decode", RECORDING, "--to", "jsonl"),
        ("stats", RECORDING),
        ("doctor", RECORDING),
        ("map", RECORDING),
        ("learn", RECORDING),
        ("show", "11 03 00 6B 00 03 76 87"),
        ("explain", "3"),
        ("craft", "3", "unit=17", "address=107", "quantity=3"),
        ("formats",),
    ],
    ids=" ".join,
)
def test_a_command_needs_no_scapy(words: tuple[str, ...]) -> None:
    """An import of scapy would fail here."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *words],
        cwd=ROOT, env=environment(), capture_output=True, text=True, check=False, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout
