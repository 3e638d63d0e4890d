"""`modlens doctor ARCHIVE --to csv`: a row for each bus and day."""

from __future__ import annotations

import argparse
import csv
import io

from analyzer.archive.days import bus_days
from analyzer.archive.recordings import find_recordings
from analyzer.bus_days import COLUMNS
from analyzer.cli.chosen_settings import settings
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED, SIGNALLED
from analyzer.cli.segmentation import report_silence_limits
from analyzer.cli.standard_streams import print_text
from analyzer.cli.stop_signals import StopSignals
from analyzer.cores import cores
from analyzer.session import RecordingStatus
from dissectors.errors import CaptureError

__all__ = ["run_bus_days"]


def run_bus_days(options: argparse.Namespace, messages: Messages) -> int:
    """Examine the archive, print the rows; gives the exit status."""
    chosen = settings(options)
    report_silence_limits(chosen, messages)
    unreadable: list[str] = []

    def listen(status: RecordingStatus) -> None:
        if status.unreadable or "trouble" in status.details:
            unreadable.append(status.name)
            reason = status.details.get("trouble", status.reason)
            messages.error(f"{status.name}: {reason}")

    with StopSignals() as stop_signals:
        rows = bus_days(
            find_recordings(options.files, options.bus_names),
            chosen,
            read_as=options.read_as,
            threads=options.threads or cores(),
            stop=stop_signals.received,
            progress=messages.progress,
            on_status=listen,
        )
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        print_text(text.getvalue())
        if stop_signals.signal is not None:
            return SIGNALLED + stop_signals.signal
    if unreadable:
        return CaptureError.exit_status
    is_sick = any(row["verdict"] in ("trouble", "broken") for row in rows)
    return DAMAGED if options.strict and is_sick else 0
