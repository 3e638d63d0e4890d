"""`modlens report`: one page that shows what is on the bus, whether it is healthy, what to do."""

from __future__ import annotations

import argparse

from analyzer.cli.comparison import comparison
from analyzer.cli.learned_tables import learned_tables
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import SIGNALLED
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.recording_document import RecordingDocument, write_page
from analyzer.cli.selection import add_selection
from analyzer.cli.stop_signals import StopSignals
from analyzer.page import page as viewer
from analyzer.report.page import page
from dissectors.errors import CaptureError, UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens report recording.jsonl --line 19200-8E1 -o report.html
  modlens report monday.pcap tuesday.pcap -o week.html
  modlens report tuesday.pcap --against monday.pcap -o tuesday.html
  modlens report day.pcapng --learn -o day.html
  modlens report --viewer -o viewer.html

The page needs no network and can be mailed. The viewer is the page of
`modlens page`: drop the JSON of `modlens stats --to json` on it.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser, optional=True)
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.add_argument(
        "-o",
        dest="output",
        metavar="FILE",
        required=True,
        help="the page to write, such as report.html; - is standard output",
    )
    parser.add_argument(
        "--title",
        metavar="TEXT",
        help="name of the plant or bus at the top of the page (default: the name in the bus file or"
        " in the recording, else what the files' names have in common)",
    )
    parser.add_argument(
        "--against",
        metavar="FILE",
        action="append",
        help="a recording from before: the page has a section of what differs from it, as modlens"
        " diff finds it; repeatable, for several recordings that are compared as one",
    )
    parser.add_argument(
        "--learn",
        action="store_true",
        help="the page has sections of what modlens learn finds out about registers: what you can"
        " settle, each value and how it moved, equations between them; reads the recordings twice",
    )
    parser.add_argument(
        "--viewer",
        action="store_true",
        help="write a page without data, on which documents of stats --to json can be dropped",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Decode the recordings, then write the page; gives the exit status."""
    if options.viewer == bool(options.files):
        raise UsageError("report: name recordings, or --viewer for a page without data")
    if options.viewer and options.learn:
        raise UsageError("report: --learn looks at recordings; a page without data has none")
    if options.viewer and options.against:
        raise UsageError("report: --against compares recordings; a page without data has none")
    if options.viewer:
        write_page(options.output, viewer())
        return 0
    messages = Messages(quiet=False, timezone=options.timezone)
    with StopSignals() as stop_signals:
        recording = RecordingDocument(options, messages, stop_signals)
        document = recording.document
        if options.against and stop_signals.signal is None:
            document = {**document, "comparison": [comparison(options)]}
        if options.learn and stop_signals.signal is None:
            document = {**document, "learned": learned_tables(options)}
        write_page(options.output, page(document))
        if stop_signals.signal is not None:
            return SIGNALLED + stop_signals.signal
    messages.info(recording.document["doctor"]["sentence"])
    return CaptureError.exit_status if recording.unreadable else 0
