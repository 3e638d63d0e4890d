"""`modlens tap`: what happens on a serial line, live. It listens only."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import ExitStack, closing

from analyzer.cli.notes import Notes
from analyzer.cli.parser import add_decoding, add_line, add_rows
from analyzer.cli.running import DAMAGED, TABLE, Outputs, run_settings
from analyzer.cli.segmentation import announce
from analyzer.cli.stopping import Stopping
from analyzer.exports.recorder import Recorded, Recorder, keeping, rotation
from analyzer.line import EXAMPLE
from analyzer.session import LiveRun
from analyzer.sources.serial import Chunk
from analyzer.views.summary import damaged
from dissectors.errors import SourceError, UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens tap /dev/ttyUSB0 --line 19200-8E1
  modlens tap /dev/ttyUSB0 --line 9600-8N1 -o today.csv --where "status != 'ok'"
  modlens tap socket://192.168.1.50:4001 --line 19200-8E1 --to jsonl

A B are two buses; A+B is one bus of which each direction has its own port.
-o adds a file that grows while the tap runs; it must not exist yet.
--record keeps every read with its time, for modlens decode; where the file
exists already, or with --rotate, its segments get numbers and times.
Ctrl-C ends.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("ports", nargs="+", metavar="PORT", help="a device or a URL, see below")
    group = parser.add_argument_group("raw recording")
    group.add_argument("--record", metavar="FILE", help="every read with its time, as pcapng")
    group.add_argument("--rotate", metavar="N", help="a new file after a time or size: 1h, 64MB")
    group.add_argument("--keep", metavar="N", help="only so many files, or so much: 24, 2GB")
    add_line(parser)
    add_rows(parser)
    add_decoding(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Listen until a signal comes; gives the exit status."""
    settings = run_settings(options)
    if settings.line is None:
        raise UsageError(
            "tap: the line settings are needed: add --line and baud, data bits, parity and stop"
            f" bits in one word, as --line {EXAMPLE}"
        )
    notes = Notes(quiet=False)
    announce(settings, notes)
    recording = _recorder(options, str(settings.line), notes)
    recorders: list[Recorder] = []

    def heard(bus: str, line: str | None, chunk: Chunk) -> None:
        for recorder in recorders:
            recorder.heard(bus, line, chunk)

    with ExitStack() as opened:
        stopping = opened.enter_context(Stopping())
        live = opened.enter_context(closing(LiveRun(options.ports, settings, heard=heard)))
        with Outputs(options, notes, to=options.to or TABLE, growing=True) as outputs:
            ports = ", ".join(options.ports)
            notes.say(f"listening to {ports} at {settings.line}; nothing is sent; Ctrl-C ends")
            if recording is not None:  # the ports are open: there is something to record
                recorders.append(opened.enter_context(closing(recording())))
            try:
                outputs.pump(live, stopping)
            finally:
                outputs.close()
                stats = live.stats()
                if not outputs.silenced:
                    notes.summary(stats)
    if options.strict and damaged(stats) and not outputs.status:
        return DAMAGED
    return outputs.status


def _recorder(
    options: argparse.Namespace, line: str, notes: Notes
) -> Callable[[], Recorder] | None:
    """What begins the raw recording that the options ask for."""
    if options.record is None:
        if options.rotate or options.keep:
            raise UsageError("--rotate and --keep are for --record FILE")
        return None
    rotate = None if options.rotate is None else rotation(options.rotate)
    keep = None if options.keep is None else keeping(options.keep)
    ports = [
        Recorded(name, letter if "+" in name else None, port, line)
        for name in options.ports
        for port, letter in zip(name.split("+"), "AB", strict=False)
    ]

    def failed(error: SourceError) -> None:
        notes.trouble(f"{error.message}; the recording has ended")

    return lambda: Recorder(
        options.record, ports, rotate=rotate, keep=keep, told=notes.say, failed=failed
    )
