"""Threads that share the work on one recording; what comes out is what one thread gives.

The caller does what only one can do, and in order: it decodes. What can be done side by side it
leaves to whoever is free, itself included: to prepare what it has decoded for an output (`submit`),
and to read what it will need next (`ahead`). Nothing here knows what the work is.

>>> written = []
>>> with Pool(2) as pool:
...     for number in pool.ahead(iter(range(4))):
...         pool.submit(lambda number=number: lambda: written.append(number))
>>> written
[0, 1, 2, 3]
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from threading import Condition, Thread
from typing import Any, Generic, Self, TypeVar

__all__ = ["MOST_WEIGHT", "Pool"]

T = TypeVar("T")

_MOST_READ = 3
"""Items that `ahead` has ready: they take memory."""

MOST_WEIGHT = 20_000
"""What tasks that are not finished may weigh: they take memory, and a slow disk has to slow the
decoder down."""


class Pool:
    """As many threads as are given, the caller's among them; use it in `with`.

    At the end all that was submitted is done. What a task raises is raised once, by the next
    `submit` or at the end, and what was submitted after it is dropped.
    """

    def __init__(self, threads: int) -> None:
        # Guards all that follows; whoever waits is woken when any of it changes.
        self._changed = Condition()
        self._tasks: deque[_Task] = deque()
        self._weight = 0
        self._waiting: deque[_Task] = deque()
        self._source: _Source[Any] | None = None
        self._is_finishing = False
        self._has_failed = False
        self._error: BaseException | None = None
        self._has_ended = False
        self._threads = [
            Thread(target=self._help, name=f"modlens {number}", daemon=True)
            for number in range(1, threads)
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        # A second Ctrl-C waits for nobody: a thread may wait for who reads its output.
        waits = kind is None or issubclass(kind, Exception)
        try:
            while waits and self._tasks:
                self._work_or_wait(lambda: not self._tasks)
        except BaseException:
            waits = False
            raise
        finally:
            with self._changed:
                self._has_ended = True
                self._changed.notify_all()
            for thread in self._threads if waits else ():
                thread.join()
        self._raise()

    def submit(self, prepare: Callable[[], Callable[[], None]], weight: int = 1) -> None:
        """Have `prepare` called by any thread, and what it gives in the order of submission.

        What it gives is called by one thread at a time. Where more than `MOST_WEIGHT` waits, the
        caller takes part in the work.
        """
        self._raise()
        while not self._has_room(weight):
            self._work_or_wait(lambda: self._has_room(weight))
        task = _Task(prepare, weight)
        with self._changed:
            self._tasks.append(task)
            self._waiting.append(task)
            self._weight += weight
            self._changed.notify()

    def _has_room(self, weight: int) -> bool:
        return not self._tasks or self._weight + weight <= MOST_WEIGHT

    def ahead(self, items: Iterator[T]) -> Generator[T, None, None]:
        """The items, each made by any thread, before the caller asks for it where one is free.

        What making one raises is raised in its place. One `ahead` at a time; when it is closed,
        nobody uses `items` any more.
        """
        source = _Source(items)
        with self._changed:
            self._source = source
            self._changed.notify()
        try:
            while True:
                while not source.made and not source.has_ended:
                    self._work_or_wait(lambda: bool(source.made) or source.has_ended)
                with self._changed:
                    if not source.made:
                        break
                    item = source.made.popleft()
                    self._changed.notify()
                yield item
            if source.error is not None:
                raise source.error
        finally:
            with self._changed:
                self._source = None
                self._changed.wait_for(lambda: not source.is_in_use)

    def _help(self) -> None:
        """The life of a thread beside the caller's."""
        while not self._has_ended:
            self._work_or_wait(lambda: self._has_ended)

    def _work_or_wait(self, is_over: Callable[[], bool]) -> None:
        """Do one part of the work; where there is none, wait for some, or until `is_over()`."""
        with self._changed:
            while True:
                if is_over():
                    return
                source = self._source if self._source and self._source.has_room() else None
                # The caller waits for the next item, and cannot make further tasks before.
                if self._waiting and not (source and not source.made):
                    task, source = self._waiting.popleft(), None
                    break
                if source:
                    source.is_in_use = True
                    break
                self._changed.wait()
        if source is None:
            task.prepare(is_dropped=self._has_failed)
            self._finish_prepared(task)
        else:
            source.make_one()
            with self._changed:
                source.is_in_use = False
                self._changed.notify_all()

    def _finish_prepared(self, task: _Task) -> None:
        """Finish the tasks that are prepared, up to the first that is not, unless another does."""
        with self._changed:
            task.is_prepared = True
            if self._is_finishing:
                return
            self._is_finishing = True
        while True:
            with self._changed:
                if not (self._tasks and self._tasks[0].is_prepared):
                    self._is_finishing = False
                    self._changed.notify_all()
                    return
                task = self._tasks[0]
            if not self._has_failed:
                try:
                    task.finish()
                except BaseException as error:  # Raised again by `submit`.
                    self._error, self._has_failed = error, True
            with self._changed:
                self._tasks.popleft()
                self._weight -= task.weight
                self._changed.notify_all()

    def _raise(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error


class _Task:
    """Something to prepare in any thread, and then to finish in order."""

    def __init__(self, prepare: Callable[[], Callable[[], None]], weight: int) -> None:
        self.weight = weight
        self._prepare: Callable[[], Callable[[], None]] | None = prepare
        self._finish: Callable[[], None] | None = None
        self._error: BaseException | None = None
        self.is_prepared = False

    def prepare(self, *, is_dropped: bool) -> None:
        """Prepare it; what that raises is raised by `finish`."""
        prepare, self._prepare = self._prepare, None
        if is_dropped or prepare is None:
            return
        try:
            self._finish = prepare()
        except BaseException as error:  # Raised in the order of tasks.
            self._error = error

    def finish(self) -> None:
        """Finish it."""
        finish, self._finish = self._finish, None
        if self._error is not None:
            raise self._error
        if finish is not None:
            finish()


class _Source(Generic[T]):
    """Items that are made before they are asked for."""

    def __init__(self, items: Iterator[T]) -> None:
        self._items = items
        self.made: deque[T] = deque()
        self.has_ended = False
        self.error: BaseException | None = None
        self.is_in_use = False

    def has_room(self) -> bool:
        """Whether an item may be made now."""
        return not self.is_in_use and not self.has_ended and len(self.made) < _MOST_READ

    def make_one(self) -> None:
        """Make the next item."""
        try:
            self.made.append(next(self._items))
        except StopIteration:
            self.has_ended = True
        except BaseException as error:  # Raised where the item would have been taken.
            self.error, self.has_ended = error, True
