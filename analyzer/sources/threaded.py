"""What ports have in common that a thread of Python reads."""

from __future__ import annotations

import threading
from collections.abc import Mapping

from _modlens import Inbox

__all__ = ["ThreadedPort"]


class ThreadedPort:
    """A port without line settings, read by a thread; a `schemes.LivePort` but for `close`.

    A subclass defines `read`, which passes reads to the inbox until `stopped` is set, and looks at
    that at least a few times a second.
    """

    takes_line_settings = False
    marks_errors = False
    advice = ""

    def __init__(self) -> None:
        self.stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def read(self, inbox: Inbox, number: int) -> None:
        """Pass what arrives to the inbox, and None where the port ends by itself."""
        raise NotImplementedError

    def listen(self, inbox: Inbox, number: int) -> None:
        """Pass what arrives to the inbox from now on."""
        self._thread = threading.Thread(target=self.read, args=(inbox, number), daemon=True)
        self._thread.start()

    def set_line(self, line: str) -> None:
        """Nothing: the other side has the settings."""

    def counters(self) -> Mapping[str, int]:
        """No error counters."""
        return {}

    def stop(self) -> None:
        """End the thread."""
        self.stopped.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
