"""Options of commands: none takes the place of another's value."""

from __future__ import annotations

import argparse
import importlib
from collections import defaultdict

import pytest

from analyzer.cli import COMMANDS, module_of


@pytest.mark.parametrize("name", COMMANDS)
def test_each_value_has_one_option(name: str) -> None:
    """What two arguments of a command write to, one of them silently loses.

    Options that are several words for one value (`--no-x`) are of different kinds, and share a
    default; positionals share with nobody.
    """
    parser = argparse.ArgumentParser()
    importlib.import_module(module_of(name)).add_arguments(parser)
    places = defaultdict(list)
    for action in parser._actions:  # argparse has no other way to ask
        places[action.dest].append(action)
    for place, actions in places.items():
        if len(actions) > 1:
            assert all(action.option_strings for action in actions), place
            assert all(action.nargs == 0 for action in actions), place
