"""What gives batches of rows, what takes them, and how they get from one to the other.

An `analyzer.session.FileRun` and an `analyzer.live_run.LiveRun` are runs; tables on the screen,
files and feeds are sinks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import _modlens
from dissectors.errors import SourceError

if TYPE_CHECKING:
    from analyzer.pool import Pool

__all__ = ["PartialBatch", "Run", "Sink", "pump"]


_ROWS_AT_ONCE = 2000
"""Batches with so many rows are one task of a pool: for each task, threads may have to wait."""


@dataclass(frozen=True, slots=True)
class PartialBatch:
    """Some rows of a batch; sinks take it as a `_modlens.Batch`.

    `whole` is the batch itself, for the core's writers of captures.
    """

    whole: _modlens.Batch
    frames: _modlens.Table
    transactions: _modlens.Table
    findings: _modlens.Table
    readings: _modlens.Table
    connections: _modlens.Table
    diagnoses: _modlens.Table


class Run(Protocol):
    """One pass over an input, a recording or a live tap."""

    def batches(self) -> Iterator[_modlens.Batch]:
        """Batches of decoded rows to the end of the input; some may be empty."""

    def finish(self) -> _modlens.Batch:
        """Decide what is still open when the caller takes no more batches, and give those rows."""

    def stats(self) -> dict[str, Any]:
        """Statistics so far; analyzer/views/stats.py documents the keys."""

    def doctor(self) -> dict[str, Any]:
        """What the doctor says so far; analyzer/views/health.py documents the keys."""

    def document(self) -> dict[str, Any]:
        """Doctor, statistics and overview so far; docs/stats.schema.json describes them."""


class Sink(Protocol):
    """Takes batches: a file, a stream, a table on the screen.

    One whose rows can be encoded by any thread, also before those in front of them, has a method
    `begin` as `analyzer.exports.sink.ExportSink` has it.
    """

    name: str

    def put(self, batch: _modlens.Batch) -> None:
        """Write what the batch holds for this sink.

        `SourceError` if that fails, `BrokenPipeError` if nobody reads.
        """


def pump(
    run: Run,
    sinks: Sequence[Sink],
    *,
    stop: Callable[[], bool],
    on_failure: Callable[[Sink, SourceError | BrokenPipeError], None],
    pool: Pool | None = None,
) -> None:
    """Pass the run's batches to the sinks until it ends, `stop()` is True, or no sink is left.

    A sink that cannot write is reported to `on_failure` and gets no more batches; the others go on.
    Errors of the input are raised after the sinks have got all rows decided before. With a `pool`
    the sinks work in any of its threads while the next rows are decoded; they get the same batches
    in the same order, one at a time, and `on_failure` is called from there.
    """
    taking = _Taking(sinks, on_failure, pool)
    try:
        for batch in run.batches():
            taking.take(batch)
            if stop() or not taking.active:
                break
    finally:
        taking.take(run.finish(), is_last=True)


class _Taking:
    """The sinks that have not failed yet, and how they get batches."""

    def __init__(
        self,
        sinks: Sequence[Sink],
        on_failure: Callable[[Sink, SourceError | BrokenPipeError], None],
        pool: Pool | None,
    ) -> None:
        self.active = list(sinks)
        self._on_failure = on_failure
        self._pool = pool
        self._waiting: list[_modlens.Batch] = []
        self._rows = 0

    def take(self, batch: _modlens.Batch, *, is_last: bool = False) -> None:
        """Pass a batch to the sinks, or to the pool as soon as there are enough."""
        if self._pool is None:
            self._write([(sink, partial(sink.put, batch)) for sink in self.active])
            return
        count = batch.row_count
        if is_last or count:
            self._waiting.append(batch)
            self._rows += count
        if is_last or self._rows >= _ROWS_AT_ONCE:
            batches, rows = self._waiting, self._rows
            self._waiting, self._rows = [], 0
            self._pool.submit(self._begin(batches), rows)

    def _begin(self, batches: Iterable[_modlens.Batch]) -> Callable[[], Callable[[], None]]:
        """What encodes batches in any thread, and gives what writes them in their order."""
        encoders = [(sink, _begin(sink, batch)) for batch in batches for sink in self.active]

        def encode() -> Callable[[], None]:
            writers = [(sink, begun()) for sink, begun in encoders if sink in self.active]
            return partial(self._write, writers)

        return encode

    def _write(self, writers: Iterable[tuple[Sink, Callable[[], None]]]) -> None:
        for sink, write in writers:
            if sink not in self.active:
                continue
            try:
                write()
            except (SourceError, BrokenPipeError) as error:
                self.active.remove(sink)
                self._on_failure(sink, error)


def _begin(sink: Sink, batch: _modlens.Batch) -> Callable[[], Callable[[], None]]:
    """What encodes a batch in any thread, and gives what writes it in its order.

    A sink without a method `begin` does all in its order.
    """
    begin: Callable[[_modlens.Batch], Callable[[], Callable[[], None]]] | None
    begin = getattr(sink, "begin", None)
    return (lambda: partial(sink.put, batch)) if begin is None else begin(batch)
