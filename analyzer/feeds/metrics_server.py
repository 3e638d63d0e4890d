"""The HTTP server of the metrics, which a stranger in the network cannot fill.

A server with a thread for every connection holds as many as somebody opens. Here a few are served
at a time, and who comes when all places are taken gets that of the oldest.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

__all__ = ["MAX_CONNECTIONS", "BoundedServer"]

MAX_CONNECTIONS = 16
"""Connections at a time; a Prometheus has one."""

_IDLE_S = 5.0
"""A connection on which nothing arrives for so long is closed."""


class _Handler(WSGIRequestHandler):
    timeout = _IDLE_S

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the base's name
        """Nothing: the terminal belongs to the tap."""


class BoundedServer(ThreadingMixIn, WSGIServer):
    """Serves an application on `where` (host, port) in its own threads; `OSError` if it cannot."""

    daemon_threads = True
    request_queue_size = MAX_CONNECTIONS

    def __init__(self, where: tuple[str, int], application: Callable[..., Any]) -> None:
        family, _, _, _, address = socket.getaddrinfo(
            *where, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        self.address_family = family
        self._open: dict[socket.socket, None] = {}
        self._lock = threading.Lock()
        super().__init__(address[:2], _Handler)  # type: ignore[arg-type] # of IPv6, host and port
        self.set_app(application)
        self._thread = threading.Thread(target=self.serve_forever, daemon=True)
        self._thread.start()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread, in place of the oldest one if there are too many."""
        with self._lock:
            if len(self._open) >= MAX_CONNECTIONS:
                oldest = next(iter(self._open))
                del self._open[oldest]
                with contextlib.suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)  # its thread wakes and ends
            self._open[request] = None
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection, whose place is free again."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing: a client that goes away in the middle is no error of the tap."""

    def stop(self) -> None:
        """Stop serving."""
        self.shutdown()
        self.server_close()
        self._thread.join()
