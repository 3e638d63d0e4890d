"""What tap, decode and export have in common: open the outputs, pump, close them.

If the input fails, exports that are not whole are taken away (a live tap's files grow in place and
stay).
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from os.path import isfile
from typing import Protocol

from analyzer.cli.between import chosen
from analyzer.cli.messages import Notes
from analyzer.cli.parser import settings
from analyzer.cli.segmentation import announce
from analyzer.cli.standard_streams import STDOUT, discard_output
from analyzer.cli.stop_signals import Stopping
from analyzer.exports import Wish
from analyzer.exports.sink import ExportSink, Target, check_style, fitting, tables_of, target
from analyzer.session import FileRun, Run, Settings, Sink, pump
from analyzer.views.row_lines import Look
from analyzer.views.screen import stdout
from analyzer.views.summary import damaged
from analyzer.views.table_sink import TableSink
from dissectors.errors import SourceError, UsageError

__all__ = ["DAMAGED", "LiveSink", "Outputs", "run_files", "run_settings", "targets"]

DAMAGED = 1
SIGNALLED = 128

TABLE = "table"
"""The word of `--to` that means the table for people."""


def run_settings(options: argparse.Namespace) -> Settings:
    """The settings, with the tables that the outputs need."""
    wanted = targets(options)
    if options.to not in (None, TABLE):
        wanted.append(fitting(Target(options.table, options.to, None), named=False))
    tables = tables_of(wanted) | {options.table}
    return replace(settings(options), tables=tuple(sorted(tables)))


def run_files(
    options: argparse.Namespace, *, to: str | None, quiet: bool, follow: bool = False
) -> int:
    """Decode the files of the options into all outputs; gives the exit status."""
    notes = Notes(quiet=quiet)
    chosen = run_settings(options)
    announce(chosen, notes)
    run = FileRun(
        options.files,
        chosen,
        read_as=options.read_as,
        replay=getattr(options, "replay", False),
        told=notes.intake,
        follow=follow,
    )
    with Stopping() as stopping, Outputs(options, notes, to=to, names=options.files) as outputs:
        outputs.pump(run, stopping.asked)
        outputs.close()
        if outputs.silenced:
            return 0
        stats = run.stats()
        notes.summary(stats)
        if stopping.signal is not None:
            notes.trouble("interrupted: the outputs hold what was decoded until then")
            return SIGNALLED + stopping.signal
    if options.strict and (damaged(stats) or notes.unparsed) and not outputs.status:
        return DAMAGED
    return outputs.status


class LiveSink(Sink, Protocol):
    """A sink that counts its rows and can be closed; `table` is empty where nothing is written."""

    table: str
    rows: int

    def close(self) -> None:
        """All rows are there."""

    def abandon(self) -> None:
        """The input failed: leave nothing half written."""


class Outputs:
    """All sinks of a run; `to` is what goes to standard output: the table, a format, or nothing.

    `status` is the exit status of what went wrong with them; `silenced` is True when the only
    reader has gone away. Those that are not closed when the `with` ends are taken away. `names` are
    the buses; `more` are sinks that somebody else has made.
    """

    def __init__(  # noqa: PLR0913 - all but two by keyword
        self,
        options: argparse.Namespace,
        notes: Notes,
        *,
        to: str | None,
        names: Sequence[str],
        growing: bool = False,
        more: Sequence[LiveSink] = (),
    ) -> None:
        self.status = 0
        self.silenced = False
        self._notes = notes
        where = chosen(options.where, options.between)
        self._filtered = where is not None
        self._sinks: list[LiveSink] = list(more)
        self._watching: list[Sink] = []
        self._failures = 0
        wanted = [] if getattr(options, "around", None) else targets(options)
        with ExitStack() as opened:
            if to == TABLE:
                look = Look(options.address, options.times, tuple(names))
                if options.columns is not None and not wanted:
                    raise UsageError("--columns is for exports; add --to csv or -o FILE")
                self._sinks.append(TableSink(options.table, stdout(), look, where=where))
            elif to is not None:
                wanted.insert(0, fitting(Target(options.table, to, None), named=False))
            check_style(options.style, wanted)
            if options.context < 0:
                raise UsageError("--context: a number of frames, 0 or more")
            wish = Wish(
                "",
                (),
                style=options.style or "",
                context=options.context,
                address=options.address,
                times=options.times,
                buses=tuple(names),
            )
            for one in wanted:
                sink = ExportSink(
                    one, columns=options.columns, where=where, growing=growing, wish=wish
                )
                opened.callback(sink.abandon)
                self._sinks.append(sink)
            self._opened = opened.pop_all()
        if not self._sinks:
            raise UsageError("nowhere to write to; add -o FILE or --to FORMAT")

    def pump(self, run: Run, stop: Callable[[], bool]) -> None:
        """Pass everything through until `stop()` says so, or nobody is left to write to.

        Errors of the input are raised when the sinks have got what came before.
        """
        pump(
            run,
            [*self._watching, *self._sinks],
            stop=lambda: stop() or self._failures >= len(self._sinks),
            failed=self._failed,
        )

    def watch(self, *sinks: Sink) -> None:
        """Show them everything, too; they write nothing."""
        self._watching += sinks

    def close(self) -> None:
        """All rows are there: the files take their names."""
        for sink in self._sinks:
            try:
                sink.close()
            except (SourceError, BrokenPipeError) as error:
                self._failed(sink, error)
                continue
            if sink.table and (not isinstance(sink, TableSink) or self._filtered):
                self._notes.say(f"{sink.name}: {sink.rows:,} {sink.table}")
            remark = sink.remark() if isinstance(sink, ExportSink) else ""
            if remark:
                self._notes.say(f"{sink.name}: {remark}")

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, *error: object) -> None:
        self._opened.close()

    def _failed(self, sink: Sink, error: SourceError | BrokenPipeError) -> None:
        self._failures += 1
        if isinstance(error, BrokenPipeError):
            self.silenced = len(self._sinks) == 1
            discard_output(STDOUT)
            return
        self.status = max(self.status, error.exit_status)
        self._notes.trouble(error.message)


def targets(options: argparse.Namespace) -> list[Target]:
    """What `-o` asks for; `UsageError` for two in one file, and for one that is read, too."""
    found = [target(text, options.table) for text in options.outputs]
    read = {os.path.realpath(name) for name in getattr(options, "files", ()) if isfile(name)}
    seen = set()
    for one in found:
        path = os.path.realpath(one.path or "")
        if path in read:
            raise UsageError(f"-o {one.path}: this is the recording itself; choose another name")
        if path in seen:
            raise UsageError(f"-o {one.path}: two outputs in one file; give each a name of its own")
        seen.add(path)
    return found
