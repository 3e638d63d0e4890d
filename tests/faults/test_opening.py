"""Nothing reaches the line when a tap opens its port, as far as the kernel allows."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from tests.conftest import need_program

if sys.platform != "linux":
    pytest.skip("Linux opens ports with echo", allow_module_level=True)

from tests.faults.opening import OPENER, TAPS, build_gateway, echoed

FIRST_CALLS = ["flock", "TCSETS", "TCFLSH", "TIOCMBIC"]
"""Lock, raw without asking first, drop what waits to be sent, lower DTR and RTS."""


@pytest.fixture(scope="module")
def _gateway() -> None:
    build_gateway()


@pytest.mark.usefixtures("_gateway")
@pytest.mark.parametrize("name", TAPS)
def test_both_taps_open_a_port_by_the_same_calls(name: str, tmp_path: Path) -> None:
    """No modem line is raised, nothing is written, and the first call to the driver ends echo."""
    need_program("strace")
    trace = tmp_path / "trace"
    echoed(TAPS[name], trace=trace)
    calls = [line for line in trace.read_text().splitlines() if re.search(r"</dev/pts/\d+>", line)]
    opened = next(number for number, call in enumerate(calls) if " open" in call)
    assert "O_RDONLY" in calls[opened]
    first = calls[opened + 1 : opened + 1 + len(FIRST_CALLS)]
    assert [word for word, call in zip(FIRST_CALLS, first, strict=True) if word in call] == (
        FIRST_CALLS
    ), first
    assert not [call for call in calls if re.search(r"write\(|send|TIOCMBIS|TIOCMSET|TCSBRK", call)]
    assert not re.search(r"\bECHO\b", first[1]), first[1]


def test_a_slow_driver_makes_the_echo_no_shorter() -> None:
    """What remains of the echo comes of the time that the first call takes: ioctls of 20 ms."""
    need_program("strace")
    slow_us = 20_000
    opener = (sys.executable, "-c", OPENER)
    one_call = echoed(opener, slow_us)
    assert echoed(opener) <= one_call


def test_openings_give_nothing_back() -> None:
    """Ports in the kernel's default state, bytes all the time; `make openings` takes 1,000."""
    counts = [echoed((sys.executable, "-c", OPENER)) for _ in range(10)]
    # A machine that stops the thread between two calls lets a few bytes through.
    assert sum(count > 0 for count in counts) <= 1, counts
