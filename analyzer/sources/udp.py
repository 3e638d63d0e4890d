"""Datagrams with raw bytes of a line, as some serial device servers send them: `udp://HOST:PORT`.

HOST is an address of this computer, 0.0.0.0 for all of them. The sender is configured to send
there. Nothing is ever sent back.
"""

from __future__ import annotations

import contextlib
import socket
from urllib.parse import urlsplit

from _modlens import Inbox
from analyzer.sources.schemes import LivePort
from analyzer.sources.threaded import ThreadedPort
from dissectors.errors import PortError, UsageError

__all__ = ["open_port"]

_MAX_DATAGRAM = 65_535
_CHECK_S = 0.1
"""How often the thread looks whether it has been stopped."""


def open_port(name: str, settings: str | None) -> LivePort:
    """Listen for datagrams; `PortError` if the address cannot be had, `UsageError` for no port."""
    return _UdpPort(name)


class _UdpPort(ThreadedPort):
    """A bound socket, read by a thread; a `schemes.LivePort`."""

    def __init__(self, name: str) -> None:
        super().__init__()
        place = urlsplit(name)
        try:
            port = place.port
        except ValueError:
            port = None
        if not port:
            raise UsageError(f"{name}: write the address and port to listen at: udp://0.0.0.0:4001")
        host = place.hostname or "0.0.0.0"
        self._socket = socket.socket(
            socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM
        )
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise PortError(
                f"cannot listen there: {error.strerror or error}; HOST is an address of this"
                " computer",
                port=name,
            ) from error
        self._socket.settimeout(_CHECK_S)

    def close(self) -> None:
        """Stop reading and close the socket."""
        self.stop()
        with contextlib.suppress(OSError):
            self._socket.close()

    def read(self, inbox: Inbox, number: int) -> None:
        """Pass each datagram to the inbox."""
        while not self.stopped.is_set():
            try:
                data = self._socket.recv(_MAX_DATAGRAM)
            except TimeoutError:
                continue
            except OSError:
                inbox.put(number, None)
                return
            if data:
                inbox.put(number, data)
