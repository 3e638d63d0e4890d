"""The live screens over a recording, with a clock that stands still: the same in every run.

    python -m tests.support.live_screen captures/pymodbus_two_units/recording.jsonl log

Keys work as in a tap; q ends. What was noted goes to standard output at the end.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

from analyzer.cli.live_screen import LiveScreen
from analyzer.line import parse_line
from analyzer.live_run import BusStatus
from analyzer.session import FileRun
from analyzer.settings import Settings
from analyzer.views.live.state import LiveState
from analyzer.views.row_lines import TableOptions
from analyzer.views.screen import stdout

SECONDS = 83.0


def main(path: str, view: str) -> None:
    """Put all of the recording on the board, then obey the keys."""
    settings = Settings(line=parse_line("19200-8E1"))
    settings = replace(settings, tables=(*settings.tables, "diagnoses"))
    run = FileRun([path], settings)
    ended: list[bool] = []
    ticks = iter([0.0])
    status = BusStatus(path, "19200-8E1", "given", None)
    state = LiveState(
        TableOptions("wire", "utc", (path,)),
        run.stats,
        lambda: [status],
        lambda: run.doctor() if ended else None,
        clock=lambda: next(ticks, SECONDS),
    )
    screen = LiveScreen(state, view, stdout())
    with screen:
        for batch in run.batches():
            screen.put(batch)
        empty = run.finish()
        ended.append(True)
        screen.draw()
        while not screen.quit_requested:
            screen.put(empty)
            time.sleep(0.02)
    sys.stdout.write("\n".join(screen.messages))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
