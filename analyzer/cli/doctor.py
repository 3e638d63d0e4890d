"""`modlens doctor`: what is wrong on the line, why, and what to do."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.live_watch import add_watch, live_watch, with_watched_tables
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED, SIGNALLED
from analyzer.cli.parser import add_archive, add_decoding, add_input, add_line
from analyzer.cli.segmentation import report_silence_limits
from analyzer.cli.selection import add_selection, check_selected
from analyzer.cli.standard_streams import print_text
from analyzer.cli.stop_signals import StopSignals
from analyzer.cli.troubles_output import add_notify, take_event_files, troubles
from analyzer.feeds.troubles import line
from analyzer.pump import Sink
from analyzer.views.health import show_health
from analyzer.views.health_markdown import markdown
from analyzer.views.screen import stdout
from analyzer.views.security import render, show_findings
from dissectors.errors import CaptureError, UsageError

__all__ = ["add_arguments", "run"]

FORMATS = ("json", "md", "csv")
SICK = ("trouble", "broken")

EPILOG = """\
examples:
  modlens doctor recording.jsonl --line 19200-8E1
  modlens doctor capture.pcap --to md
  modlens doctor archive/ --to csv
  dumpcap -i eth0 -f "tcp port 502" -w - | modlens doctor - --follow
  modlens show recording.jsonl --txn 25
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    _add_follow(parser)
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    add_watch(parser)
    add_archive(parser, "buses examined side by side with --to csv")
    parser.add_argument(
        "--to",
        choices=FORMATS,
        help="write to standard output, instead of text: json, md (Markdown, for a ticket), or csv:"
        " a row for each bus and day",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help="exit with status 1 if a cause is diagnosed (not only suspected), or requests fail"
        " without a known cause",
    )
    parser.epilog = EPILOG


def _add_follow(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("while a recording grows")
    group.add_argument(
        "--follow",
        action="store_true",
        help="keep reading as the last file grows, until Ctrl-C, and print a line when a trouble"
        " begins, changes or ends",
    )
    group.add_argument(
        "-o",
        dest="outputs",
        action="append",
        default=[],
        metavar="events:FILE",
        help="with --follow: a file (.jsonl) with a line for each of these events (repeatable)",
    )
    add_notify(group)


def run(options: argparse.Namespace) -> int:
    """Decode the recordings, then say what is wrong; gives the exit status."""
    messages = Messages(quiet=options.to is not None, timezone=options.timezone)
    if options.to == "csv":
        # What works on many files at once is loaded for them only.
        from analyzer.cli.archive_days import run_bus_days  # noqa: PLC0415

        return run_bus_days(options, messages)
    _check_events(options)
    chosen = with_watched_tables(options, replace(settings(options), tables=("diagnoses",)))
    watch = live_watch(options, lambda text: None)
    report_silence_limits(chosen, messages)
    files = file_run(options, chosen, messages, follow=options.follow)
    with StopSignals() as stop_signals, ExitStack() as opened:
        listeners: list[Callable[[Mapping[str, Any]], None]] = [
            lambda event: messages.info(line(event, names_bus=True))
        ]
        watched, notifiers = troubles(options, files.events, listeners, messages.info, opened)
        sinks: list[Sink] = [watched, *notifiers, *([] if watch is None else [watch])]
        for batch in files.batches():
            for sink in sinks:
                sink.put(batch)
            if stop_signals.received():
                files.finish()
                break
        check_selected(options, files.stats(), messages)
        found = files.doctor()
        if watch is not None:
            watch.finish()
            found["security"] = [one.row() for one in watch.found]
        _print(options.to, found)
        # A signal is the only way to end `--follow`.
        if stop_signals.signal is not None and not options.follow:
            return SIGNALLED + stop_signals.signal
    if files.unreadable:
        return CaptureError.exit_status
    return DAMAGED if options.strict and is_sick(found) else 0


def _check_events(options: argparse.Namespace) -> None:
    """Take the files for events from the outputs; `UsageError` for any others."""
    take_event_files(options)
    if options.outputs:
        raise UsageError(f"doctor: -o {options.outputs[0]}: write -o events:FILE.jsonl")
    if (options.event_files or options.notify) and not options.follow:
        raise UsageError("doctor: -o events:FILE and --notify need --follow")


def is_sick(found: Mapping[str, Any]) -> bool:
    """Whether `--strict` ends with status 1: suspicions and notes are no reason."""
    if any(row["certainty"] == "diagnosed" for row in found["diagnoses"]):
        return found["verdict"] in SICK
    return found["verdict"] in SICK and not found["diagnoses"]


def _print(form: str | None, found: Mapping[str, Any]) -> None:
    """Print the judgement in a format; as text if there is none."""
    if form is None:
        show_health(found, stdout())
        if "security" in found:
            stdout().line("Security: " + ("no finding." if not found["security"] else ""), "head")
            show_findings(found["security"], stdout())
    elif form == "json":
        print_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n")
    else:
        security = "\n" + render(found["security"], "md") if "security" in found else ""
        print_text("".join(markdown(found)) + security)
