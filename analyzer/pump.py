"""What gives batches of rows, what takes them, and how they get from one to the other.

An `analyzer.session.FileRun` and an `analyzer.live_run.LiveRun` are runs; tables on the screen,
files and feeds are sinks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import _modlens
from dissectors.errors import SourceError

__all__ = ["PartialBatch", "Run", "Sink", "pump"]


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
    """Takes batches: a file, a stream, a table on the screen."""

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
) -> None:
    """Pass the run's batches to the sinks until it ends, `stop()` is True, or no sink is left.

    A sink that cannot write is reported to `on_failure` and gets no more batches; the others go on.
    Errors of the input are raised after the sinks have got all rows decided before.
    """
    active = list(sinks)

    def put(batch: _modlens.Batch) -> None:
        for sink in tuple(active):
            try:
                sink.put(batch)
            except (SourceError, BrokenPipeError) as error:
                active.remove(sink)
                on_failure(sink, error)

    try:
        for batch in run.batches():
            put(batch)
            if stop() or not active:
                break
    finally:
        put(run.finish())
