"""The outputs of tap, decode and export: opens them, passes batches to them, closes them.

If the input fails, incomplete export files are deleted; if a signal ends the run, they are kept as
`NAME.partial`, and what stood under the name stays. The files of a live tap grow in place and stay.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from os.path import isfile
from typing import TYPE_CHECKING, Literal, Protocol

from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.ignored import ignored_in
from analyzer.cli.live_watch import live_watch, with_watched_tables
from analyzer.cli.messages import Messages
from analyzer.cli.segmentation import report_silence_limits
from analyzer.cli.standard_streams import STDOUT, discard_output
from analyzer.cli.stop_signals import StopSignals
from analyzer.cores import cores
from analyzer.counts import count_of
from analyzer.exports import ExportOptions
from analyzer.exports.sink import (
    ExportSink,
    Target,
    check_style,
    parse_target,
    required_tables,
    with_suitable_table,
)
from analyzer.pump import Run, Sink, pump
from analyzer.settings import Settings
from analyzer.views.screen import stdout
from analyzer.views.summary import damaged
from dissectors.errors import CaptureError, SourceError, UsageError

if TYPE_CHECKING:
    from analyzer.pool import Pool

__all__ = ["DAMAGED", "OutputSink", "Outputs", "run_files", "run_settings", "targets"]

DAMAGED = 1
SIGNALLED = 128

LARGE_BYTES = 4 << 20
"""From so many bytes of recordings on, several threads share the work."""

MOST_THREADS = 4
"""One thread decodes, and all other work on a recording keeps no more than three busy."""

TABLE = "table"
"""The value of `--to` that means the table for people on standard output."""

_DATELESS = (
    "a log without a date or zone has none but seconds since its start (--date and --timezone give"
    " them)"
)
NO_SUCH_TIME = (
    "--between: no row has such a time; times without a zone are those of the table (--times), and"
    f" {_DATELESS}"
)
NO_MATCH = f"--where: no row matches; times without a zone are UTC, and {_DATELESS}"


def run_settings(options: argparse.Namespace) -> Settings:
    """The settings from the options, with the tables that the outputs need."""
    wanted = targets(options)
    if options.to not in (None, TABLE):
        wanted.append(with_suitable_table(Target(options.table, options.to, None), named=False))
    tables = required_tables(wanted) | {options.table}
    return replace(settings(options), tables=tuple(sorted(tables)))


def run_files(
    options: argparse.Namespace, *, to: str | None, quiet: bool, follow: bool = False
) -> int:
    """Decode the input files into all outputs; gives the exit status."""
    messages = Messages(
        quiet=quiet,
        rows_on_terminal=to is not None and sys.stdout.isatty(),
        timezone=options.timezone,
    )
    _follow_outputs(options, to)
    settings = with_watched_tables(options, run_settings(options))
    watch = live_watch(options, messages.info)
    report_silence_limits(settings, messages)
    pool = None if follow else _pool(options)
    run = file_run(options, settings, messages, follow=follow, pool=pool)
    with (
        StopSignals() as stop_signals,
        Outputs(
            options, messages, to=to, names=options.files, stopping=stop_signals.received
        ) as outputs,
    ):
        outputs.add_observers(*() if watch is None else (watch,))
        with pool or nullcontext():
            outputs.pump(run, stop_signals.received, pool=pool)
        if watch is not None:
            watch.finish()
        signal = stop_signals.signal
        # A signal is the only way to end `--follow`, whose outputs are complete then.
        outputs.close(interrupted=signal is not None and not follow)
        if outputs.reader_gone:
            return 0
        if signal is not None:
            messages.error(_interruption(outputs.partial))
        if outputs.are_full:
            # Counts of a part, cut in the middle of an exchange, would be taken for those of all.
            messages.info("--limit: reading stopped there; without it, the summary counts all rows")
        elif not quiet:
            messages.summary(run.stats())
        if signal is not None:
            return SIGNALLED + signal
    if options.strict and not outputs.status and (messages.unparsed_lines or damaged(run.stats())):
        return DAMAGED
    return max(outputs.status, CaptureError.exit_status if run.unreadable else 0)


def _follow_outputs(options: argparse.Namespace, to: str | None) -> None:
    """Let `--where` be of the table that all outputs name, such as `-o readings:flow.csv`."""
    tables = {one.table for one in targets(options)}
    if to is None and len(tables) == 1:
        options.table = tables.pop()


def _pool(options: argparse.Namespace) -> Pool | None:
    """The threads that share the work; None where the caller's is enough."""
    count = threads_for(options.files, getattr(options, "threads", None))
    if count == 1:
        return None
    from analyzer.pool import Pool  # noqa: PLC0415 - small recordings need no threads

    return Pool(count)


def threads_for(names: Sequence[str], threads: int | None) -> int:
    """How many threads share the work on these recordings.

    `threads` is what the user allows, None as many as there are cores; those beyond a few would
    have nothing to do. Where another process is read from, nothing waits for rows anyway, and what
    is small is done before a thread has begun.
    """
    if not all(map(isfile, names)) or sum(map(os.path.getsize, names)) < LARGE_BYTES:
        return 1
    return max(1, min(threads or cores(), MOST_THREADS))


def _interruption(partial: Sequence[str]) -> str:
    """The message after a signal; `partial` are the names of the files that are incomplete."""
    if not partial:
        return "interrupted: the outputs hold what was decoded until then"
    names = ", ".join(partial)
    return f"interrupted: what was decoded until then is in {names}; older files are unchanged"


class OutputSink(Sink, Protocol):
    """A sink that counts its rows and can be closed.

    `table` names the table whose rows it writes, and is empty for a sink that writes none. One
    that hands rows on to others says by `outcome()`, once it is closed, what became of them.
    """

    table: str
    row_count: int

    def close(self) -> None:
        """Complete the output: no more rows will come."""

    def rollback(self) -> None:
        """Discard the output because the input failed: no incomplete file is left."""


def _outcome(sink: OutputSink) -> str:
    """What became of the rows of a sink that is closed."""
    outcome = getattr(sink, "outcome", None)
    if outcome is not None:
        return str(outcome())
    return f"{count_of(sink.row_count, sink.table.removesuffix('s'))} written"


class Outputs:
    """All sinks of a run; use it in `with`, which rolls back the sinks that have not been closed.

    `to` says what goes to standard output: `TABLE`, an export format, or None for nothing. `names`
    are the names of the buses, `extra_sinks` are sinks that the caller has made, `stopping` says
    whether a signal has asked the program to end. `status` is the
    exit status for what went wrong in the sinks; `partial` are the files of an interrupted run;
    `reader_gone` is True when standard output was the only sink and its reader has closed the pipe.
    """

    def __init__(  # noqa: PLR0913 - all but two by keyword
        self,
        options: argparse.Namespace,
        messages: Messages,
        *,
        to: str | None,
        names: Sequence[str],
        growing: bool = False,
        extra_sinks: Sequence[OutputSink] = (),
        stopping: Callable[[], bool] | None = None,
    ) -> None:
        self.status = 0
        self.reader_gone = False
        self.partial: list[str] = []
        self._messages = messages
        zone: Literal["local", "utc"] = "utc" if options.times == "utc" else "local"
        where = _filter(options, zone)
        self._filtered = where is not None
        notes, by_time = ((), False) if where is None else _remarks(where, options.table)
        self._without_rows = ""
        if by_time:
            from analyzer.cli.between import is_over_midnight  # noqa: PLC0415 - rarely given

            self._without_rows = NO_SUCH_TIME if options.between is not None else NO_MATCH
            if options.between is not None and is_over_midnight(options.between):
                self._without_rows += (
                    "; T2 is earlier in the day than T1, which means over midnight"
                )
        for note in notes:
            messages.info(f"--where: {note}")
        self._sinks: list[OutputSink] = list(extra_sinks)
        self._on_screen: OutputSink | None = None
        self._observers: list[Sink] = []
        self._failures = 0
        wanted = [] if getattr(options, "around", None) else targets(options)
        with ExitStack() as opened:
            if to == TABLE:
                from analyzer.views.row_lines import TableOptions  # noqa: PLC0415 - as below
                from analyzer.views.table_sink import TableSink  # noqa: PLC0415 - not for `export`

                table_options = TableOptions(options.address, options.times, tuple(names))
                if options.columns is not None and not wanted:
                    raise UsageError("--columns needs --to csv or -o FILE")
                self._on_screen = TableSink(
                    options.table, stdout(), table_options, where=where, limit=options.limit
                )
                self._sinks.append(self._on_screen)
            elif to is not None:
                wanted.insert(0, with_suitable_table(Target(options.table, to, None), named=False))
            for note in ignored_in(options, to, [one.format for one in wanted]):
                messages.info(note)
            check_style(options.style, wanted)
            if options.context < 0:
                raise UsageError("--context: a number of frames, 0 or more")
            if options.limit is not None and options.limit < 1:
                raise UsageError("--limit: a number of rows, 1 or more")
            export_options = ExportOptions(
                "",
                (),
                style=options.style or "",
                context=options.context,
                address=options.address,
                times=options.times,
                buses=tuple(names),
                stopping=stopping,
            )
            for one in wanted:
                sink = ExportSink(
                    one,
                    columns=options.columns,
                    where=where,
                    growing=growing,
                    options=export_options,
                    limit=options.limit,
                )
                opened.callback(sink.rollback)
                self._sinks.append(sink)
            self._opened = opened.pop_all()
        if not self._sinks:
            raise UsageError("no output given; add -o FILE or --to FORMAT")

    def pump(self, run: Run, stop: Callable[[], bool], *, pool: Pool | None = None) -> None:
        """Pass the run's batches to the sinks until `stop()` is True or all sinks have failed.

        Errors of the input are raised after the sinks have got the batches before. The threads of a
        `pool` write the files, if all of them can be written by any thread.
        """
        sinks = [*self._observers, *self._sinks]
        pump(
            run,
            sinks,
            stop=lambda: stop() or self._failures >= len(self._sinks) or self.are_full,
            on_failure=self._on_failure,
            pool=pool if all(getattr(sink, "any_thread", False) for sink in sinks) else None,
        )

    @property
    def are_full(self) -> bool:
        """Whether every output has the rows that `--limit` allows it."""
        return all(getattr(sink, "is_full", False) for sink in self._sinks)

    def add_observers(self, *sinks: Sink) -> None:
        """Pass all batches to these sinks as well; they write nothing and need no closing."""
        self._observers += sinks

    def close(self, *, interrupted: bool = False) -> None:
        """Complete all outputs, whose files take their final names, and report their row counts.

        Where the run was `interrupted`, files that appear when they are complete become `partial`.
        """
        for sink in self._sinks:
            name = sink.name
            try:
                if isinstance(sink, ExportSink):
                    sink.close(interrupted=interrupted)
                else:
                    sink.close()
            except (SourceError, BrokenPipeError) as error:
                self._on_failure(sink, error)
                continue
            if sink.name != name:
                self.partial.append(sink.name)
            if sink.table and (sink is not self._on_screen or self._filtered):
                self._messages.info(f"{sink.name}: {_outcome(sink)}")
            if self._without_rows and sink.table and not sink.row_count:
                self._messages.error(self._without_rows)
            remark = sink.closing_remark() if isinstance(sink, ExportSink) else ""
            if remark:
                self._messages.info(f"{sink.name}: {remark}")
            for empty in sink.empty_columns() if isinstance(sink, ExportSink) else ():
                self._messages.error(f"{sink.name}: {empty}")

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, *error: object) -> None:
        self._opened.close()

    def _on_failure(self, sink: Sink, error: SourceError | BrokenPipeError) -> None:
        self._failures += 1
        if isinstance(error, BrokenPipeError):
            self.reader_gone = len(self._sinks) == 1
            discard_output(STDOUT)
            return
        self.status = max(self.status, error.exit_status)
        self._messages.error(error.message)


def _filter(options: argparse.Namespace, zone: Literal["local", "utc"]) -> str | None:
    """The filter that `--where` and `--between` make together; None where neither is given."""
    if options.between is None:
        where: str | None = options.where
        return where
    from analyzer.cli.between import combine_filters  # noqa: PLC0415 - rarely given

    return combine_filters(options.where, options.between, zone=zone, table=options.table)


def _remarks(where: str, table: str) -> tuple[Sequence[str], bool]:
    """The notes on a filter, and whether it compares moments."""
    from analyzer.filters import parse  # noqa: PLC0415 - loaded where there is a filter

    found = parse(where, table)
    return found.notes, bool(found.columns & {"time", "opened"})


def targets(options: argparse.Namespace) -> list[Target]:
    """The targets of the `-o` options.

    `UsageError` where two outputs name the same file, or an output would overwrite an input.
    """
    found = [parse_target(text, options.table) for text in options.outputs]
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
