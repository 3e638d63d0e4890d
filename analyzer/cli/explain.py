"""`modlens explain`.

A function, an exception or a finding in words, with its section and an example.
"""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence

import _modlens
from analyzer.cli.chosen_settings import load_functions
from analyzer.cli.parser import add_functions
from analyzer.explanations import WordGroups, explain_word, word_groups
from analyzer.views.screen import Screen, fit, stdout, visible
from dissectors.errors import UsageError
from dissectors.explain import Explanation

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens explain 3
  modlens explain exception 2
  modlens explain 0x83 2
  modlens explain bad_checksum
  modlens explain list
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "words",
        nargs="+",
        metavar="CODE",
        help="a function or exception code, or the name of a function, finding, status or column;"
        " several names are explained one after the other; list prints all of them",
    )
    add_functions(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Explain; gives the exit status."""
    source = load_functions(options.functions)
    screen = stdout()
    if options.words == ["list"]:
        _draw_list(word_groups(source), screen)
        return 0
    for number, found in enumerate(_explanations(options.words, source)):
        if number:
            screen.line("")
        _draw(found, screen)
    return 0


def _draw_list(groups: WordGroups, screen: Screen) -> None:
    """Prints the names of each group, each with one line on what it is."""
    for number, (title, entries) in enumerate(groups.items()):
        if number:
            screen.line("")
        screen.line(title, "head")
        width = min(max(map(len, entries)), _NAME_WIDTH)
        for word, meaning in entries.items():
            screen.line(fit(visible(f"{word:{width}}  {meaning}"), screen.width).rstrip())


_NAME_WIDTH = 34


def _draw(found: Explanation, screen: Screen) -> None:
    width = min(screen.width, 100)
    screen.line(visible(found.title), "head")
    if found.section:
        screen.line(visible(found.section), "dim")
    for line in _body(found, width):
        screen.line(visible(line))


def _explanations(words: Sequence[str], source: _modlens.Functions) -> list[Explanation]:
    """What the words mean together, such as `exception 2`; otherwise each name by itself."""
    try:
        return [explain_word(" ".join(words), source)]
    except UsageError:
        if len(words) == 1 or any(word[:1].isdigit() for word in words):
            raise
        try:
            return [explain_word(word, source) for word in words]
        except UsageError:
            pass
        raise


def _body(found: Explanation, width: int) -> list[str]:
    lines: list[str] = []
    for paragraph in found.text:
        lines += ["", *textwrap.wrap(paragraph, width)]
    if found.example:
        lines += ["", "Example"]
        for line in found.example:
            lines += _indented(line, width)
    return lines


def _indented(line: str, width: int) -> list[str]:
    """A line of an example, indented by two spaces, wrapped with a hanging indent."""
    start = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.wrap(line, width, initial_indent="  ", subsequent_indent=f"{start}  ")
