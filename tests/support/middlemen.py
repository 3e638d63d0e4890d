"""Servers of Modbus/TCP that misbehave: a real pymodbus server after a middleman of sockets.

Each connection of a client is one to the server after it; what the middleman does with the answers,
and with the connections, is the trouble.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Callable

__all__ = ["Idle", "Middleman", "Mixing", "OneBehind", "OneClient", "OnlyKnown"]

HEADER = 6
Note = Callable[[str, bytes], None]


class Middleman:
    """Hands requests on and answers back, whole frames at a time; `note` gets what is sent."""

    idle_s: float | None = None

    def __init__(self, port: int, behind: int, note: Note) -> None:
        """Listen at once."""
        self._behind, self._note = behind, note
        self._listener = socket.create_server(("127.0.0.1", port))
        self._open = 0
        self._requests = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """No further connections."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def welcome(self, client: socket.socket) -> bool:
        """Whether a client may stay."""
        return True

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """What the client is given; None for nothing."""
        return answer

    def _accept(self) -> None:
        number = 0
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                if self.welcome(client):
                    self._open += 1
                    number += 1
                    arguments = (client, number)
                    threading.Thread(target=self._serve, args=arguments, daemon=True).start()

    def _serve(self, client: socket.socket, who: int) -> None:
        client.settimeout(self.idle_s)
        with client, socket.create_connection(("127.0.0.1", self._behind)) as server:
            with contextlib.suppress(TimeoutError, ConnectionError):
                while request := _frame(client):
                    self._requests += 1
                    server.sendall(request)
                    answer = self.answer(who, _frame(server))
                    if answer is not None:
                        self._note("response", answer)
                        client.sendall(answer)
        self._open -= 1


class OneClient(Middleman):
    """Lets one client in; others are reset as soon as they are connected."""

    def welcome(self, client: socket.socket) -> bool:
        """Whether nobody else is there."""
        if self._open:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            client.close()
            return False
        return True


class Idle(Middleman):
    """Closes a connection on which nothing was asked for half a second."""

    idle_s = 0.5


class OneBehind(Middleman):
    """Keeps the tenth answer back, and from there on gives each answer to the next request."""

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """The one before, under its own transaction id."""
        kept, self._kept = getattr(self, "_kept", None), answer
        if self._requests < 10:
            return answer
        return None if self._requests == 10 else kept


class OnlyKnown(Middleman):
    """Drops what the server after says about a unit that it does not have."""

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """None instead of an exception of unit 255."""
        return None if answer[HEADER] == 255 else answer


class Mixing(Middleman):
    """Gives each fourth request the latest answer of the other client."""

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """Its own, or the other one's under this request's transaction id."""
        latest: dict[int, bytes] = self.__dict__.setdefault("_latest", {})
        other = next((last for client, last in latest.items() if client != who), None)
        latest[who] = answer
        mixes = other is not None and self._requests % 4 == 0
        return answer[:2] + other[2:] if mixes and other is not None else answer


def _frame(connection: socket.socket) -> bytes:
    """The next whole frame; empty at the end."""
    head = _exactly(connection, HEADER)
    return head + _exactly(connection, int.from_bytes(head[4:])) if head else b""


def _exactly(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        piece = connection.recv(count - len(data))
        if not piece:
            return b""
        data += piece
    return data
