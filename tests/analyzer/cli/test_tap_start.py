"""A tap that starts inside an exchange reports nothing about it, live or from its recording."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("the line is a Linux pty", allow_module_level=True)

from analyzer import decode
from tests.conftest import Modlens
from tests.support.tapped_line import PAIR, TappedLine

REQUEST_BYTES = 8
EXCHANGES = 12


@pytest.mark.parametrize(
    "missing", [3, REQUEST_BYTES - 1, REQUEST_BYTES, REQUEST_BYTES + 3], ids="{} bytes".format
)
def test_nothing_is_reported_about_it(missing: int, tmp_path: Path, modlens: Modlens) -> None:
    """The rest of a request, a whole response, the rest of one: no finding, no failure."""
    recording = tmp_path / "bus.pcapng"
    with TappedLine("--record", recording) as tap:
        tap.start()
        tap.wait_for("recording to")
        for start in (missing, *[0] * EXCHANGES):
            for part in (PAIR[start:REQUEST_BYTES], PAIR[max(start, REQUEST_BYTES) :]):
                os.write(tap.far, part)
                time.sleep(0.02)
        tap.end()
    assert f"{EXCHANGES} transactions: ok {EXCHANGES}" in tap.said
    assert "findings" not in tap.said
    read = decode(recording)
    assert [row.status for row in read.transactions] == ["ok"] * EXCHANGES
    assert not len(read.findings)
    done = modlens("doctor", str(recording))
    assert "This line is healthy" in done.out
    assert f"{EXCHANGES} of {EXCHANGES} requests" in done.out
