"""Work on many recordings at once, a thread for each, with progress and a way to stop.

Threads are enough: the core decodes and encodes outside of Python's lock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Protocol, TypeVar

from analyzer.archive.recordings import ArchivedRecording

__all__ = ["Position", "side_by_side"]

_LOOK_S = 0.2
"""How often progress is reported and the stop asked for while nothing ends."""

Result = TypeVar("Result")


class Progress(Protocol):
    """Gets how far the whole has come, in bytes."""

    def advance(self, done: int, total: int | None) -> None:
        """So many bytes, of so many."""

    def wipe(self) -> None:
        """Nothing more comes."""


class Position:
    """How far the reading of one recording has come; a `Progress` of its run."""

    done = 0

    def advance(self, done: int, total: int | None) -> None:
        """Remember the position."""
        self.done = done

    def wipe(self) -> None:
        """Nothing to do."""


def side_by_side(
    recordings: Sequence[ArchivedRecording],
    work: Callable[[ArchivedRecording, Position], Result],
    *,
    threads: int,
    stop: Callable[[], bool],
    progress: Progress,
) -> Iterator[tuple[ArchivedRecording, Result]]:
    """Work on the recordings; gives each with its result, in the order in which they are done.

    Large ones are begun first, so that no core is idle at the end. After `stop()` no further one is
    begun; `work` has to look by itself. What `work` raises is raised here.
    """
    waiting = sorted(recordings, key=lambda one: one.size)
    total, finished = sum(one.size for one in recordings), 0
    running: dict[Future[Result], tuple[ArchivedRecording, Position]] = {}
    with ThreadPoolExecutor(threads) as pool:

        def begin() -> None:
            while waiting and len(running) < threads and not stop():
                one, position = waiting.pop(), Position()
                running[pool.submit(work, one, position)] = one, position

        try:
            begin()
            while running:
                done, _ = wait(running, _LOOK_S, FIRST_COMPLETED)
                results = [(running.pop(future)[0], future) for future in done]
                # The threads go on while the caller writes down what is done.
                begin()
                for one, future in results:
                    finished += one.size
                    yield one, future.result()
                progress.advance(finished + sum(at.done for _, at in running.values()), total)
        finally:
            progress.wipe()
            for future in running:
                future.cancel()
