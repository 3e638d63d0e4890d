"""What the command line takes, read off its parsers: for completion and manual pages."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from analyzer.cli import COMMANDS, parser_of

__all__ = ["Command", "Option", "commands"]

_FILES = ("FILE", "OUT", "[BUS=]FILE", "FILE|HEX", "NAME|FILE", "FILE[:NAME]", "[UNITS=]NAME|FILE")


@dataclass(frozen=True, slots=True)
class Option:
    """An option or positional argument.

    `flags` are its names, and empty for a positional; `value` is the name of what follows it, empty
    for a switch; `choices` are all values that there are, where they can be counted.
    """

    flags: tuple[str, ...]
    value: str
    choices: tuple[str, ...]
    help: str
    group: str

    @property
    def takes_file(self) -> bool:
        """Whether its value can be a file."""
        return self.value in _FILES or self.value.startswith("PORT")


@dataclass(frozen=True, slots=True)
class Command:
    """A command of modlens: what it does, what it takes, and examples or notes."""

    name: str
    summary: str
    usage: str
    options: tuple[Option, ...]
    epilog: str

    @property
    def flags(self) -> list[str]:
        """The names of all options, the long one where there is one."""
        return sorted(one.flags[-1] for one in self.options if one.flags)

    @property
    def words(self) -> list[str]:
        """What may be in place of its positional arguments, where that can be counted."""
        return [word for one in self.options if not one.flags for word in one.choices]

    @property
    def takes_files(self) -> bool:
        """Whether a positional argument can be a file."""
        return any(one.takes_file for one in self.options if not one.flags)


def commands() -> list[Command]:
    """All commands, in the order of `modlens --help`."""
    return [_command(name) for name in COMMANDS]


def _command(name: str) -> Command:
    parser = parser_of(name)
    options = [
        _option(action, group.title or "")
        for group in parser._action_groups
        for action in group._group_actions
    ]
    usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
    return Command(name, COMMANDS[name], usage, tuple(options), parser.epilog or "")


def _option(action: argparse.Action, group: str) -> Option:
    choices = tuple(map(str, action.choices or ()))
    value = ""
    if action.nargs != 0:
        name = action.metavar or ("WORD" if choices else action.dest.upper())
        value = " ".join(name) if isinstance(name, tuple) else name
    return Option(tuple(action.option_strings), value, choices, action.help or "", group)
