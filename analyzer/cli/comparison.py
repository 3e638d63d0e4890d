"""What differs between recordings: the rows of `modlens diff`, for the report."""

from __future__ import annotations

import argparse
from typing import Any

from analyzer.cli.messages import Messages
from analyzer.cli.watched_files import watched
from analyzer.security import rules
from analyzer.views.security import time_text

__all__ = ["comparison"]


def comparison(options: argparse.Namespace) -> dict[str, Any]:
    """Compare the recordings of `--against` with those of the command."""
    # What is to be said about the files of the command was said when the page's figures were made.
    messages = Messages(quiet=True, timezone=options.timezone)
    before, _ = watched(options, rules(), messages, options.against)
    after, _ = watched(options, rules(), messages, options.files)
    rows = [one.row() for one in after.deviations(before.usage(), values=True)]
    return {
        "before": ", ".join(options.against),
        "differences": [{**row, "first": _first(row["since_ns"])} for row in rows],
    }


def _first(since_ns: int | None) -> str | None:
    return None if since_ns is None else time_text(since_ns)
