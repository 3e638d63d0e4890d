"""The pass over recordings that the commands about security and baselines share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

from analyzer.baseline_file import loads
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.messages import Messages
from analyzer.cli.stop_signals import StopSignals
from analyzer.security import Rule, Watch
from dissectors.errors import CaptureError, SourceError

__all__ = ["read_baseline", "watched"]


def watched(
    options: argparse.Namespace,
    table: Sequence[Rule],
    messages: Messages,
    files: Sequence[str] | None = None,
) -> tuple[Watch, int]:
    """Look at the recordings; gives what was seen, and the exit status of reading them."""
    chosen = replace(settings(options), tables=("transactions", "frames", "connections"))
    run = file_run(options, chosen, messages, files=files)
    watch = Watch(table)
    with StopSignals() as stop_signals:
        for batch in run.batches():
            watch.add(batch)
            if stop_signals.received():
                run.finish()
                break
    watch.finish()
    return watch, CaptureError.exit_status if run.unreadable else 0


def read_baseline(path: str) -> dict[str, object]:
    """Read a baseline file; `SourceError` or `ProfileError` if that is not possible."""
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read()
    except (OSError, UnicodeError) as error:
        raise SourceError(f"{path}: cannot be read: {error}") from error
    return loads(text, path)
