"""`modlens ports`: lists the serial adapters of this machine and their properties."""

from __future__ import annotations

import argparse

from analyzer.sources.adapters import Adapter, adapters
from analyzer.sources.schemes import SCHEMES
from analyzer.views.screen import stdout, visible

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command has no options."""
    parser.epilog = "`modlens tap PORT` detects the line settings by listening; it never sends."


def run(options: argparse.Namespace) -> int:
    """List them; gives the exit status."""
    screen = stdout()
    found = adapters()
    for one in found:
        for line in _describe(one):
            screen.line(line)
    if not found:
        screen.line("no serial port found; is the adapter plugged in?")
    others = ", ".join(scheme.example for name, scheme in SCHEMES.items() if name)
    screen.line(f"also possible, for example: {others}")
    return 0


def _describe(one: Adapter) -> list[str]:
    chip = f"{one.chip.name}, " if one.chip else ""
    lines = [f"{visible(one.port)}: {chip}{visible(one.title) or 'serial port'}"]
    if not one.is_accessible:
        lines.append("    no permission to open it; on Linux join its group (often dialout)")
    if one.chip:
        lines.append(f"    {one.chip.behaviour}")
    lines.append(f"    {one.limit}")
    if one.stable_name:
        lines.append(f"    stable name: {visible(one.stable_name)}")
    return lines
