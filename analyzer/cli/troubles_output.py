"""Where events of troubles go: `-o events:FILE` and `--notify`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from analyzer.feeds.notify import Notifier
from analyzer.feeds.troubles import EventFile, Troubles
from dissectors.errors import UsageError

__all__ = ["add_notify", "take_event_files", "troubles"]

EVENTS = "events:"


def add_notify(group: argparse._ActionsContainer) -> None:
    """Add the option for commands and addresses that get events."""
    group.add_argument(
        "--notify",
        action="append",
        default=[],
        metavar="TARGET",
        help="run this command, or POST to this URL, when a trouble begins, changes or ends; the"
        " event is JSON on standard input or in the body (repeatable)",
    )


def take_event_files(options: argparse.Namespace) -> None:
    """Move the outputs `events:FILE` to `event_files`: they hold no table."""
    mine = [one for one in options.outputs if one.startswith(EVENTS)]
    options.outputs = [one for one in options.outputs if one not in mine]
    options.event_files = [one.removeprefix(EVENTS) for one in mine]
    for path in options.event_files:
        if not path.endswith((".jsonl", ".ndjson")):
            raise UsageError(f"-o events:{path}: events are JSON lines; name the file .jsonl")


def troubles(
    options: argparse.Namespace,
    take: Callable[[], Sequence[Mapping[str, Any]]],
    listeners: list[Callable[[Mapping[str, Any]], None]],
    say: Callable[[str], None],
    opened: ExitStack,
) -> tuple[Troubles, list[Notifier]]:
    """Return what passes the events that `take` gives to the listeners, files and notifiers.

    The second part are the notifiers, which report to `say` what they could not deliver.
    """
    notifiers: list[Notifier] = []
    for path in options.event_files:
        file = EventFile(path)
        opened.callback(file.close)
        listeners.append(file)
    for target in options.notify:
        notifier = Notifier(target, say)
        opened.callback(notifier.close)
        listeners.append(notifier)
        notifiers.append(notifier)
    return Troubles(take, listeners), notifiers
