"""`modlens join`: both sides of a gateway: which client caused what on the serial line."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace

import _modlens
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_decoding, add_input, add_line, add_list
from analyzer.cli.stop_signals import StopSignals
from analyzer.columns import Column
from analyzer.exports.joined import JOINED_FORMATS, JoinedEncoder, encoder
from analyzer.exports.output import Output, open_output
from analyzer.filters import parse
from analyzer.joining import JoinedRow, join, joined_columns, outcomes, sentences
from analyzer.views.joined import show_joined
from analyzer.views.screen import Screen, stdout
from dissectors.errors import CaptureError, UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens join gateway.pcap line.jsonl --line 19200-8E1
  modlens join gateway.pcap line.jsonl --where "writes(hr, 107)"
  modlens join gateway.pcap line.jsonl -o joined.csv --where "status != 'ok'"

The first file is the capture of the network, the second the recording of the
serial line, of the same gateway and the same time. Their clocks may differ.
modlens join --list prints the outcomes and the columns.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument(
        "--where",
        metavar="EXPR",
        help="only rows whose transaction on the line meets this condition (on the network, where"
        ' it never reached the line), such as "writes(hr, 107)"',
    )
    parser.add_argument("--columns", metavar="A,B,C", help="columns to write, in this order")
    parser.add_argument(
        "-o",
        dest="outputs",
        action="append",
        default=[],
        metavar="OUT",
        help=f"write to this file, by its ending: {', '.join(JOINED_FORMATS)}; repeatable",
    )
    parser.add_argument(
        "--to",
        choices=[name for name in JOINED_FORMATS if name != "parquet"],
        help="write to standard output, instead of the table",
    )
    add_list(parser, _list, "print the outcomes and the columns")
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Join both recordings; gives the exit status."""
    if len(options.files) != 2:  # noqa: PLR2004 - network and line
        raise UsageError(
            f"join: give the capture of the network and the recording of the line,"
            f" not {len(options.files)} files"
        )
    columns = _columns(options.columns)
    messages = Messages(quiet=options.to is not None, timezone=options.timezone)
    chosen = replace(settings(options), tables=("transactions",))
    runs = [file_run(options, chosen, messages, files=[name]) for name in options.files]
    where = None if options.where is None else json.dumps(parse(options.where).tree)
    core = _modlens.Join(where)
    sides = {"network": runs[0].batches(), "line": runs[1].batches()}
    with StopSignals() as stop_signals, ExitStack() as opened:
        sinks = _sinks(options, columns, opened)
        for rows in _until(stop_signals, join(sides, core)):
            for sink in sinks:
                sink.put(rows)
        if core.is_aligned() is False:
            raise CaptureError(
                "it has no requests and responses in common with the first file; are both of the"
                " same gateway and the same time?",
                path=options.files[1],
            )
        for sink in sinks:
            sink.close()
    for sentence in sentences(json.loads(core.summary())):
        messages.info(sentence)
    unreadable = any(one.unreadable for one in runs)
    return CaptureError.exit_status if unreadable else 0


def _until(stop_signals: StopSignals, rows: Iterator[list[JoinedRow]]) -> Iterator[list[JoinedRow]]:
    for some in rows:
        yield some
        if stop_signals.received():
            return


def _columns(text: str | None) -> list[Column]:
    known = {column.key: column for column in joined_columns()}
    if text is None:
        return list(known.values())
    wanted = [key.strip() for key in text.split(",") if key.strip()]
    for key in wanted:
        if key not in known:
            raise UsageError(f"no column {key!r} of join; the columns are {', '.join(known)}")
    if not wanted:
        raise UsageError(f"--columns names no column; the columns are {', '.join(known)}")
    return [known[key] for key in wanted]


def _sinks(
    options: argparse.Namespace, columns: Sequence[Column], opened: ExitStack
) -> list[_Table | _File]:
    sinks: list[_Table | _File] = []
    for path in options.outputs:
        sinks.append(_File(path, encoder(path.rpartition(".")[2].lower(), columns)))
        opened.callback(sinks[-1].rollback)
    if options.to is not None:
        sinks.append(_File(None, encoder(options.to, columns)))
    elif not sinks:
        sinks.append(_Table(stdout()))
    return sinks


class _Table:
    """The table on the screen."""

    def __init__(self, screen: Screen) -> None:
        self._screen = screen
        self._has_head = False

    def put(self, rows: Sequence[JoinedRow]) -> None:
        if rows:
            show_joined(rows, self._screen, head=not self._has_head)
            self._has_head = True

    def close(self) -> None:
        """Do nothing: lines are complete."""

    def rollback(self) -> None:
        """Do nothing: what is shown is shown."""


class _File:
    """A file of joined rows, or standard output for None."""

    def __init__(self, path: str | None, encoded: JoinedEncoder) -> None:
        self._encoder = encoded
        self._output: Output = open_output(path, growing=False)

    def put(self, rows: Sequence[JoinedRow]) -> None:
        self._output.append(self._encoder.rows(rows))

    def close(self) -> None:
        self._output.append(self._encoder.end())
        self._output.close()

    def rollback(self) -> None:
        self._output.rollback()


def _list(screen: Screen) -> None:
    """Show each outcome and each column in a line."""
    for word, meaning in outcomes().items():
        screen.line(f"{word:<16} {meaning}")
    screen.line("")
    for column in joined_columns():
        screen.line(f"{column.key:<16} {column.help}")
