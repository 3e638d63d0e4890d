"""`modlens` with a wall clock that a file sets: it holds the nanoseconds to add.

    python -m tests.faults.tap_with_clock FILE tap ...

libfaketime would do the same to the system's calls, but breaks `time.sleep` in the threads of the
client for MQTT.
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path
from typing import Any

from analyzer.cli import main
from analyzer.live_run import LiveRun


def follow(live: LiveRun, clock: Path) -> None:
    """Set the clock whenever the file says so."""
    while True:
        live._run.pretend(int(clock.read_text() or 0), 0)
        time.sleep(0.1)


def run(clock: Path, words: list[str]) -> int:
    """Run the command with the clock."""
    original = LiveRun.__init__

    def begin(self: LiveRun, *given: Any, **named: Any) -> None:
        original(self, *given, **named)
        threading.Thread(target=follow, args=[self, clock], daemon=True).start()

    LiveRun.__init__ = begin  # type: ignore[method-assign]
    return main(words)


if __name__ == "__main__":
    sys.exit(run(Path(sys.argv[1]), sys.argv[2:]))
