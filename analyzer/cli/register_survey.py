"""The survey of registers that `learn` and `match` work on."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import Any

import _modlens
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.messages import Messages

__all__ = ["survey"]


def survey(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Survey the registers in the input files; gives the tables of `_modlens.Survey`."""
    messages = Messages(quiet=False)
    chosen = replace(settings(options), tables=("transactions",))
    files = file_run(options, chosen, messages)
    found = _modlens.Survey()
    for batch in files.batches():
        found.add(batch)
    tables: list[dict[str, Any]] = json.loads(found.tables())
    return tables
