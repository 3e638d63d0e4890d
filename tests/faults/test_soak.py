"""A minute of `make soak`: everything at once against both taps, and nothing lost."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("paho.mqtt.client")
if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from tests.faults.opening import build_gateway
from tests.faults.soak import Soak, SoakResult

MAX_GROWTH_KB = 16_384
PROMPT_S = 15.0


def test_a_minute_with_everything_at_once(tmp_path: Path) -> None:
    """The recordings are complete, holes are marked, memory is flat, one signal is enough."""
    build_gateway()
    for result in Soak(tmp_path, 60.0).run():
        check(result)


def check(result: SoakResult) -> None:
    """Both taps have to do the same, but for the clock, which is set for one of them."""
    assert result.recorded_is_complete, result.said
    # The port went twice, the clock was set once, and the end is a hole as well.
    assert result.holes >= 3 + result.clock_marks
    assert result.clock_marks == (result.name == "modlens")
    assert result.torn_rows == 0
    assert result.rows > 500
    assert result.growth_kb < MAX_GROWTH_KB, result.memory_kb
    assert result.seconds_to_end < PROMPT_S
    assert result.status == 3  # the disk was full
    assert "recording again" in result.said
    assert " not: " not in result.said, "messages to the broker are missing"
