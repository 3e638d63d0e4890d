"""Reads a port the way a tap does, a step at a time, for tests of ports."""

from __future__ import annotations

from contextlib import closing
from typing import Self

from _modlens import Inbox, port_advice
from analyzer.line import Line
from analyzer.sources.schemes import open_port
from dissectors.errors import PortError

TIMEOUT_S = 1.0


class PortReader:
    """An open port and its inbox; use it in `with`."""

    def __init__(self, name: str, line: Line) -> None:
        """Open the port and begin to read."""
        self.port = open_port(name, str(line))
        self._name = name
        self._inbox = Inbox()
        self._waiting: list[tuple[bytes | None, int, list[int]]] = []
        self.port.listen(self._inbox, 0)

    def read(self, timeout: float = TIMEOUT_S) -> tuple[bytes, int, list[int]] | None:
        """The next read: bytes, time in ns since 1970, offsets of marked bytes; None on timeout.

        `PortError` when the port has ended.
        """
        if not self._waiting:
            taken = self._inbox.take(timeout)
            self._waiting = [(data, time_ns, errors) for _, time_ns, data, errors, *_ in taken]
        if not self._waiting:
            return None
        data, time_ns, errors = self._waiting.pop(0)
        if data is None:
            reason = port_advice(errors[0]) or "the port was lost"
            raise PortError(reason, port=self._name)
        return data, time_ns, errors

    def now_ns(self) -> int:
        """The present time on the clock of the reads."""
        return self._inbox.now_ns()

    def read_up_to(self, count: int) -> bytes:
        """Read `count` bytes in as many reads as it takes; fewer on timeout."""
        data = b""
        while len(data) < count:
            more = [one[2] or b"" for one in self._inbox.take(TIMEOUT_S)]
            if not more:
                break
            data += b"".join(more)
        return data

    def wait_until_lost(self) -> PortError:
        """Wait until the port ends; gives its error."""
        with closing(self._inbox):
            while True:
                try:
                    self.read()
                except PortError as error:
                    return error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """End the reader, close the port."""
        self._inbox.close()
        self.port.close()
