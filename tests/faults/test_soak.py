"""A minute of `make soak`: everything at once, and nothing lost."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("paho.mqtt.client")
if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from tests.faults.soak import Soak

MAX_GROWTH_KB = 16_384
PROMPT_S = 15.0


def test_a_minute_with_everything_at_once(tmp_path: Path) -> None:
    """The recording is complete, the holes are marked, memory is flat, one signal is enough."""
    result = Soak(tmp_path, 60.0).run()
    assert result.recorded_is_complete, result.said
    # The port went twice, the clock was set once, and the end is a hole as well.
    assert result.holes >= 4
    assert result.clock_marks == 1
    assert result.torn_rows == 0
    assert result.rows > 500
    assert result.growth_kb < MAX_GROWTH_KB, result.memory_kb
    assert result.seconds_to_end < PROMPT_S
    assert result.status == 3  # the disk was full
    assert "recording again" in result.said
    assert " not: " not in result.said, "messages to the broker are missing"
