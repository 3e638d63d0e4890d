"""What `learn` and `match` have in common: a recording, gone through for its registers."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import Any

import _modlens
from analyzer.cli.messages import Messages
from analyzer.cli.parser import settings
from analyzer.session import FileRun

__all__ = ["survey"]


def survey(options: argparse.Namespace) -> list[dict[str, Any]]:
    """The tables of `_modlens.Survey` over the files of the options."""
    messages = Messages(quiet=False)
    chosen = replace(settings(options), tables=("transactions",))
    files = FileRun(
        options.files, chosen, read_as=options.read_as, on_status=messages.recording_status
    )
    found = _modlens.Survey()
    for batch in files.batches():
        found.add(batch)
    tables: list[dict[str, Any]] = json.loads(found.tables())
    return tables
