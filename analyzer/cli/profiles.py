"""`modlens profiles`: the device profiles that can be named, checked, converted."""

from __future__ import annotations

import argparse
from pathlib import Path

from analyzer.cli.import_ import show_notes, write_text
from analyzer.counts import count_of
from analyzer.profiles import available_profiles, load
from analyzer.views.screen import stdout, visible
from dissectors import importers
from dissectors.errors import ModlensError, UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens profiles
  modlens profiles check meter.toml pump.yaml
  modlens profiles convert meter.toml --to csv
  modlens profiles convert meter.csv -o meter.toml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "does",
        nargs="?",
        choices=("list", "check", "convert"),
        default="list",
        help="what to do (default: list)",
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME|FILE", help="names of known profiles, or files"
    )
    parser.add_argument("--to", metavar="FORMAT", help=f"format to write: {', '.join(_written())}")
    parser.add_argument(
        "-o", dest="output", metavar="OUT", help="output file; its extension selects the format"
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """List, check or convert; gives the exit status."""
    if options.does == "list":
        _list()
    elif not options.names:
        raise UsageError(f"profiles {options.does}: name a profile or a file")
    elif options.does == "check":
        for name in options.names:
            profile = load(name)
            stdout().line(
                f"{visible(name)}: {count_of(len(profile.points), 'register')}, no mistakes", "good"
            )
    else:
        _convert(options)
    return 0


def _list() -> None:
    """Print the available profiles; one that cannot be loaded is listed with its mistake."""
    screen, available = stdout(), available_profiles()
    width = max((len(one.name) for one in available), default=0)
    for one in available:
        try:
            profile = load(one.name)
        except ModlensError as error:
            # One profile with mistakes does not keep the others from being listed.
            title = f"cannot be used: {error.message.splitlines()[0]}"
            screen.lines([[(f"{one.name:<{width}} ", "note"), (visible(title), "bad")]])
            continue
        title = f"{profile.title}, {count_of(len(profile.points), 'register')}"
        words = visible(f"{title} ({one.origin})")
        screen.lines([[(f"{one.name:<{width}} ", "note"), (words, "")]])


def _convert(options: argparse.Namespace) -> None:
    if len(options.names) != 1:
        raise UsageError("profiles convert: name one profile only")
    written = importers.write(format_of(options.to, options.output), load(options.names[0]))
    write_text(written.text, options.output)
    show_notes(written.notes)


def format_of(name: str | None, output: str | None) -> str:
    """The format of `--to`, else that of the output's suffix, else TOML."""
    if name is not None or output is None:
        return name or "toml"
    suffix = Path(output).suffix.lower()
    found = [form for form in _written() if importers.FORMATS[form].suffix == suffix]
    if not found:
        raise UsageError(f"-o {output}: name the format with --to: one of {', '.join(_written())}")
    return found[0]


def _written() -> list[str]:
    return [name for name, form in importers.FORMATS.items() if form.writes]
