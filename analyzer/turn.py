"""A lock for a thread that takes it again and again, and for others that want it once."""

from __future__ import annotations

import threading

__all__ = ["Turn"]


class Turn:
    """A lock whose waiters get their turn, although the thread that decodes takes it again at once.

    The thread that has it may take it again: what is notified may ask for statistics.
    """

    def __init__(self) -> None:
        self._queue = threading.Lock()
        self._lock = threading.Lock()
        self._owner: int | None = None
        self._depth = 0

    def __enter__(self) -> None:
        if self._owner != threading.get_ident():
            with self._queue:
                self._lock.acquire()
            self._owner = threading.get_ident()
        self._depth += 1

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        if not self._depth:
            self._owner = None
            self._lock.release()
