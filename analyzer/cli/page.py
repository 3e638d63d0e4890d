"""`modlens page`: the page that decodes recordings in a browser, with nothing installed."""

from __future__ import annotations

import argparse

from analyzer.cli.recording_document import write_page

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens page -o modlens.html

Give the file to somebody who cannot install anything, and open it in a browser:
it decodes what is dropped on it and says what is wrong on the line. It works
from a disk or a mail, and its policy forbids every connection.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "-o",
        dest="output",
        metavar="FILE",
        required=True,
        help="the page to write, such as modlens.html; - is standard output",
    )
    parser.add_argument(
        "--live",
        action="store_true",
        help="the page that `modlens tap --web` serves, for a build of modlens-tap",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Write the page; gives the exit status."""
    from analyzer.page import page  # noqa: PLC0415

    write_page(options.output, page(live=options.live))
    return 0
