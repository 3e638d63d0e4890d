"""`modlens doctor`: what is wrong on the line, why, and what to do."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import _modlens
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED, SIGNALLED
from analyzer.cli.parser import add_decoding, add_input, add_line, settings
from analyzer.cli.segmentation import report_silence_limits
from analyzer.cli.standard_streams import print_text
from analyzer.cli.stop_signals import StopSignals
from analyzer.columns import columns
from analyzer.session import FileRun
from analyzer.views.health import show_health
from analyzer.views.health_markdown import markdown
from analyzer.views.screen import stdout
from dissectors.errors import CaptureError

__all__ = ["add_arguments", "run"]

FORMATS = ("json", "md", "csv")

EPILOG = """\
examples:
  modlens doctor recording.jsonl --line 19200-8E1
  modlens doctor capture.pcap --to md
  modlens show recording.jsonl --txn 25
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    add_decoding(parser)
    add_line(parser)
    parser.add_argument(
        "--to",
        choices=FORMATS,
        help="write JSON, Markdown (for a ticket) or CSV to standard output instead of text",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help="exit with status 1 unless what was recorded is healthy",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Decode the recordings, then say what is wrong; gives the exit status."""
    messages = Messages(quiet=options.to is not None)
    chosen = replace(settings(options), tables=("diagnoses",))
    report_silence_limits(chosen, messages)
    files = FileRun(
        options.files, chosen, read_as=options.read_as, on_status=messages.recording_status
    )
    with StopSignals() as stop_signals:
        for last in files.batches():
            if stop_signals.received():
                last = files.finish()  # noqa: PLW2901 - the diagnoses come with the last rows
                break
        found = files.doctor()
        _print(options.to, found, last.diagnoses)
        if stop_signals.signal is not None:
            return SIGNALLED + stop_signals.signal
    if files.unreadable:
        return CaptureError.exit_status
    return DAMAGED if options.strict and found["verdict"] != "healthy" else 0


def _print(form: str | None, found: Mapping[str, Any], rows: _modlens.Table) -> None:
    """Print the judgement in a format; as text if there is none."""
    if form is None:
        show_health(found, stdout())
    elif form == "json":
        print_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n")
    elif form == "md":
        print_text("".join(markdown(found)))
    else:
        keys = [column.key for column in columns("diagnoses")]
        print_text(b"".join(rows.lines("csv", keys, header=True)).decode())
