"""What gives batches of rows, what takes them, and how they get from one to the other.

An `analyzer.session.FileRun` and an `analyzer.live_run.LiveRun` are runs; tables on the screen,
files and feeds are sinks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Protocol

import _modlens
from dissectors.errors import SourceError

__all__ = ["PartialBatch", "Run", "Sink", "pump"]

_MOST_WAITING = 2
"""Batches that wait for sinks in a thread of their own."""


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
    beside: bool = False,
) -> None:
    """Pass the run's batches to the sinks until it ends, `stop()` is True, or no sink is left.

    A sink that cannot write is reported to `on_failure` and gets no more batches; the others go on.
    Errors of the input are raised after the sinks have got all rows decided before. With `beside`
    the sinks work in a thread of their own while the next rows are decoded; they get the same
    batches in the same order, and `on_failure` is called from there.
    """
    active = list(sinks)

    def put(batch: _modlens.Batch) -> None:
        for sink in tuple(active):
            try:
                sink.put(batch)
            except (SourceError, BrokenPipeError) as error:
                active.remove(sink)
                on_failure(sink, error)

    with _Beside(put) if beside else nullcontext(put) as take:
        try:
            for batch in run.batches():
                take(batch)
                if stop() or not active:
                    break
        finally:
            take(run.finish())


class _Beside:
    """Puts batches in a thread of its own, in their order; use it in `with`.

    The core encodes rows outside of Python's lock, as it decodes them. What `put` raises is raised
    by the next call, and at the end.
    """

    def __init__(self, put: Callable[[_modlens.Batch], None]) -> None:
        from queue import Queue  # noqa: PLC0415 - small recordings need no threads
        from threading import Thread  # noqa: PLC0415

        self._put = put
        # Few may wait: they take memory, and a slow disk has to slow the decoder down.
        self._waiting: Queue[_modlens.Batch | None] = Queue(_MOST_WAITING)
        self._error: BaseException | None = None
        self._thread = Thread(target=self._work, name="modlens sinks", daemon=True)

    def __enter__(self) -> Callable[[_modlens.Batch], None]:
        self._thread.start()
        return self._take

    def __exit__(self, *error: object) -> None:
        self._waiting.put(None)
        self._thread.join()
        self._raise()

    def _take(self, batch: _modlens.Batch) -> None:
        self._raise()
        self._waiting.put(batch)

    def _raise(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _work(self) -> None:
        failed = False
        while (batch := self._waiting.get()) is not None:
            if failed:
                continue
            try:
                self._put(batch)
            except BaseException as error:  # Raised again where batches are given.
                self._error, failed = error, True
