"""A tap that a condition of the user ends: the rows up to there, and no finding for the end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, cast

import _modlens
from analyzer.filters import Filter, Tree
from analyzer.pump import PartialBatch, Run

__all__ = ["LimitedRun"]

CUT_OFF = ("incomplete", "noise", "bad_checksum")
"""Verdicts of a frame of which only the beginning was heard."""


class LimitedRun:
    """A run of which the rows after the first `count` transactions are left out (None: none are).

    `is_ended` says whether a condition (`--count`, `--duration`, `--stop-on`) has ended the run.
    The frame that is on the line at that moment is cut off by the user and not by trouble on the
    bus: it is left out, with its transaction and findings. Statistics and diagnoses are those of
    the moment of the end.
    """

    def __init__(self, run: Run, count: int | None, is_ended: Callable[[], bool]) -> None:
        self._run = run
        self._remaining = count
        self._is_ended = is_ended
        self._final_stats: dict[str, Any] | None = None
        self._final_doctor: dict[str, Any] | None = None
        self._final_document: dict[str, Any] | None = None

    def batches(self) -> Iterator[_modlens.Batch]:
        """The batches of the run; the last one ends with transaction number `count`."""
        for batch in self._run.batches():
            yield self._limit(batch)

    def finish(self) -> _modlens.Batch:
        """Decide what is still open; see the class for what is left out."""
        if not self._is_ended():
            return self._run.finish()
        self._final_stats, self._final_doctor = self._run.stats(), self._run.doctor()
        self._final_document = self._run.document()
        batch = self._run.finish()
        return self._limit(batch) if self._remaining == 0 else _without_cut_off(batch)

    def stats(self) -> dict[str, Any]:
        """Statistics so far, or up to the end by a condition."""
        return self._run.stats() if self._final_stats is None else self._final_stats

    def doctor(self) -> dict[str, Any]:
        """What the doctor says so far, or up to the end by a condition."""
        return self._run.doctor() if self._final_doctor is None else self._final_doctor

    def document(self) -> dict[str, Any]:
        """Doctor, statistics and overview so far, or up to the end by a condition."""
        return self._run.document() if self._final_document is None else self._final_document

    def _limit(self, batch: _modlens.Batch) -> _modlens.Batch:
        if self._remaining is None:
            return batch
        count = len(batch.transactions)
        if count < self._remaining:
            self._remaining -= count
            return batch
        kept, self._remaining = self._remaining, 0
        return _first_transactions(batch, kept)


def _first_transactions(batch: _modlens.Batch, count: int) -> _modlens.Batch:
    """The rows of the first transactions of a batch, and what the line had between them."""
    numbers, last_frame = [0], 0
    rows = batch.transactions.tuples(("txn", "request_frame", "response_frame"), 0, count)
    for txn, *frames in rows:
        numbers.append(int(txn or 0))
        last_frame = max(last_frame, *(int(frame or 0) for frame in frames))
    own = _is_one_of("txn", numbers)
    between: Tree = [
        "and",
        ["is_none", ["col", "txn"]],
        ["cmp", "<=", ["col", "frame"], ["num", last_frame]],
    ]
    return _partial(batch, own, ["or", own, between])


def _without_cut_off(batch: _modlens.Batch) -> _modlens.Batch:
    """The rows without those of the last frame of each bus and line, if it is damaged."""
    last: dict[tuple[Any, ...], tuple[Any, ...]] = {}
    for bus, line, connection, *row in batch.frames.tuples(
        ("bus", "line", "connection", "frame", "verdict")
    ):
        last[bus, line, connection] = tuple(row)
    cut = [int(frame) for frame, verdict in last.values() if verdict in CUT_OFF]
    if not cut:
        return batch
    rows = batch.transactions.tuples(("txn", "request_frame", "response_frame"))
    broken = [int(txn or 0) for txn, *frames in rows if set(frames) & set(cut)]
    of_transactions: Tree = ["not", _is_one_of("txn", [0, *broken])]
    of_frames: Tree = ["not", _is_one_of("frame", cut)]
    return _partial(batch, of_transactions, of_frames)


def _partial(batch: _modlens.Batch, of_transactions: Tree, of_frames: Tree) -> _modlens.Batch:
    """The rows that match; frames and findings by frame, transactions and readings by number."""

    def kept(table: _modlens.Table, tree: Tree) -> _modlens.Table:
        return table.where(Filter(table.name, "", tree).predicate())

    found = PartialBatch(
        batch,
        kept(batch.frames, of_frames),
        kept(batch.transactions, of_transactions),
        kept(batch.findings, of_frames),
        kept(batch.readings, of_transactions),
        batch.connections,
        batch.diagnoses,
    )
    # Sinks read the tables only; those that need the batch itself take `whole`.
    return cast(_modlens.Batch, found)


def _is_one_of(column: str, numbers: Iterable[int]) -> Tree:
    return ["in", ["col", column], ["list", [["num", number] for number in numbers]]]
