"""A child made by fork becomes the command line, without starting Python again."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

__all__ = ["become_command"]

BROKEN = 99
"""The status of a child that ended with an exception, or before it was the command."""
WRONG = 98
"""The status where the command wanted to end with a text."""


def become_command(words: Sequence[str], arrange: Callable[[], None]) -> NoReturn:
    """Run the command line in this process and end it; `arrange` sets up its streams before."""
    status = BROKEN
    try:
        arrange()
        from analyzer.cli import main  # noqa: PLC0415 - a parent that forks has loaded it

        status = main(words)
        sys.stdout.flush()
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else WRONG
    except BaseException:
        import traceback  # noqa: PLC0415

        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(status)
