"""`modlens formats`: what recordings can look like, and what can be tapped."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterator

from analyzer.cli.chosen_settings import load_dialects
from analyzer.cli.parser import add_dialects
from analyzer.exports import ENDINGS
from analyzer.exports import FORMATS as WRITTEN
from analyzer.sources import Format, all_formats
from analyzer.sources.schemes import SCHEMES
from analyzer.views.screen import Part, stdout

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_dialects(parser)
    names = (", ".join(all_formats()), ", ".join(WRITTEN))
    parser.epilog = "\n".join(
        textwrap.fill(f"{what} {listed}", 78, subsequent_indent="  ", break_on_hyphens=False)
        for what, listed in zip(("read (--from):", "written (--to):"), names, strict=True)
    )


def run(options: argparse.Namespace) -> int:
    """List the formats; gives the exit status."""
    stdout().lines(_lines(all_formats(load_dialects(options.dialects))))
    return 0


def _lines(formats: dict[str, Format]) -> Iterator[list[Part]]:
    yield [("input formats (detected from the content; --from NAME overrides)", "head")]
    for kind in formats.values():
        yield [(f"  {kind.name:<9} ", "note"), (f"{kind.title} (timestamps: {kind.clock})", "")]
        for line in kind.sample:
            yield [(f"    {line}", "dim")]
    yield [("live sources", "head")]
    for scheme in SCHEMES.values():
        yield [(f"  {scheme.example:<28}", "note"), (scheme.title, "")]
    yield [("output formats (-o FILE.EXTENSION or --to NAME)", "head")]
    yield [("  " + "  ".join(f".{name}" for name in WRITTEN), "note")]
    others = "  ".join(f"{ending} ({name})" for ending, name in ENDINGS.items())
    yield [(f"  further endings: {others}", "note")]
