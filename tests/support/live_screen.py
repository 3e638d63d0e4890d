"""The live screens over a recording, with a clock that stands still: the same in every run.

    python -m tests.support.live_screen captures/pymodbus_two_units/recording.jsonl log

Keys work as in a tap; q ends. What was noted goes to standard output at the end.
"""

from __future__ import annotations

import sys
import time

from analyzer.cli.live_screen import Cockpit
from analyzer.line import parse_line
from analyzer.session import FileRun, Settings
from analyzer.views.live.state import Board
from analyzer.views.row_lines import Look
from analyzer.views.screen import stdout

SECONDS = 83.0


def main(path: str, view: str) -> None:
    """Put all of the recording on the board, then obey the keys."""
    run = FileRun([path], Settings(line=parse_line("19200-8E1")))
    ticks = iter([0.0])
    board = Board(Look("wire", "utc", ("line",)), run.stats, clock=lambda: next(ticks, SECONDS))
    cockpit = Cockpit(board, view, stdout())
    with cockpit:
        for batch in run.batches():
            cockpit.put(batch)
        empty = run.finish()
        cockpit.draw()
        while not cockpit.leaving:
            cockpit.put(empty)
            time.sleep(0.02)
    sys.stdout.write("\n".join(cockpit.said))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
