"""The sniffer of a WB-MGE v3 gateway: `wb-mge://[USER@]host[:port]/PORT`, PORT being 1 or 2.

The gateway cuts frames itself and gives each a time in microseconds since it started. These times
are mapped to those of this computer by the message that came fastest within the last minute. To
the gateway, this client sends its login and the commands that start and stop its sniffer; nothing
is sent to the line. The gateway has one such client: its own page gets no frames meanwhile.

https://github.com/wirenboard/wb-mge
"""

from __future__ import annotations

import contextlib
import json
import os
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult, unquote, urlsplit

from _modlens import Inbox
from analyzer.installing import how_to_install
from analyzer.sources.schemes import LivePort
from analyzer.sources.threaded import ThreadedPort
from dissectors.errors import PortError, UsageError

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

__all__ = ["PASSWORD", "open_port"]

PASSWORD = "MODLENS_WB_MGE_PASSWORD"
"""The environment variable with the password of the gateway's page."""

_PORTS = ("1", "2")
_PATIENCE_S = 10.0
_CHECK_S = 0.25
"""How often the thread looks whether it has been stopped."""
_ON_THE_WAY_NS = 500_000_000
"""After so long without a message, older frames are no longer expected."""
_WINDOW_NS = 30_000_000_000
_MAX_MESSAGE = 4096


def open_port(name: str, settings: str | None) -> LivePort:
    """Start the sniffer of one port; `PortError` if that is not possible.

    `UsageError` without the package websockets, or for a name without 1 or 2 at its end.
    """
    try:
        import websockets  # noqa: F401, PLC0415 - for those who use it
    except ImportError as error:
        raise UsageError(f"{name} needs a package: {how_to_install('websockets')}") from error
    return _SnifferPort(name)


class _SnifferPort(ThreadedPort):
    """A started sniffer, read by a thread; a `schemes.LivePort`."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name
        place = urlsplit(name)
        number = place.path.strip("/")
        if number not in _PORTS or not place.hostname:
            raise UsageError(f"{name}: write the gateway's address and its port, 1 or 2")
        self._port = int(number)
        self._opened = contextlib.ExitStack()
        self._connection = self._opened.enter_context(_connect(name, place))
        try:
            self._command("start")
        except PortError:
            self.close()
            raise

    def close(self) -> None:
        """Stop the sniffer and disconnect."""
        self.stop()
        with contextlib.suppress(OSError, PortError):
            self._command("stop")
        with contextlib.suppress(OSError):
            self._opened.close()

    def _command(self, command: str) -> None:
        from websockets.exceptions import WebSocketException  # noqa: PLC0415

        try:
            self._connection.send(json.dumps({"cmd": command, "port": self._port}))
        except (WebSocketException, OSError) as error:
            raise PortError(
                "the gateway has ended the connection; put the password of its page into"
                f" {PASSWORD}, and its user into the address: wb-mge://admin@HOST/1",
                port=self._name,
            ) from error

    def read(self, inbox: Inbox, number: int) -> None:
        """Pass each frame to the inbox."""
        from websockets.exceptions import WebSocketException  # noqa: PLC0415

        clock = _Clock()
        try:
            while not self.stopped.is_set():
                try:
                    message = self._connection.recv(timeout=_CHECK_S)
                except TimeoutError:
                    inbox.tell(number, time.time_ns() - _ON_THE_WAY_NS)
                    continue
                found = _frame(message, self._port)
                if found is not None:
                    now = clock.map(found[0], time.time_ns())
                    inbox.put(number, found[1], now)
                    inbox.tell(number, now)
        except (WebSocketException, OSError):
            inbox.put(number, None)


class _Clock:
    """Maps the times of the gateway to those of this computer."""

    def __init__(self) -> None:
        self._shifts: list[int] = []
        self._since_ns = self._last_ns = 0

    def map(self, theirs_ns: int, arrived_ns: int) -> int:
        """The time of a frame: never after it arrived, and never before that of the last one."""
        shift = arrived_ns - theirs_ns
        if not self._shifts or arrived_ns - self._since_ns > _WINDOW_NS:
            self._shifts = [*self._shifts[-1:], shift]
            self._since_ns = arrived_ns
        self._shifts[-1] = min(self._shifts[-1], shift)
        self._last_ns = max(self._last_ns, theirs_ns + min(self._shifts))
        return self._last_ns


def _frame(message: str | bytes, port: int) -> tuple[int, bytes] | None:
    """Time in ns and bytes of a message about a frame of this port; None for others."""
    try:
        found = json.loads(message)
        if found["type"] != "packet" or found["port"] != port:
            return None
        return int(found["timestamp_us"]) * 1000, bytes.fromhex(found["raw"])
    except (ValueError, KeyError, TypeError):
        return None


@contextlib.contextmanager
def _connect(name: str, place: SplitResult) -> Iterator[ClientConnection]:
    """A connection to the sniffer; `PortError` if it cannot be made."""
    from websockets.exceptions import WebSocketException  # noqa: PLC0415
    from websockets.sync.client import connect  # noqa: PLC0415

    host = place.netloc.rpartition("@")[2]
    with contextlib.ExitStack() as opened:
        try:
            connection = opened.enter_context(
                connect(
                    f"ws://{host}/sniffer/ws",
                    additional_headers=_login(f"http://{host}/auth", place),
                    open_timeout=_PATIENCE_S,
                    max_size=_MAX_MESSAGE,
                    compression=None,
                    proxy=None,
                )
            )
        except (OSError, WebSocketException, ValueError) as error:
            raise PortError(f"cannot be reached: {error}", port=name) from error
        yield connection


def _login(url: str, place: SplitResult) -> dict[str, str]:
    """The cookie of a session; nothing where no user is given."""
    if place.username is None:
        return {}
    account: dict[str, Any] = {
        "login": unquote(place.username),
        "pass": os.environ.get(PASSWORD, ""),
    }
    request = urllib.request.Request(
        url, json.dumps(account).encode(), {"Content-Type": "application/json"}
    )
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(request, timeout=_PATIENCE_S) as answer:
        cookies = answer.headers.get_all("Set-Cookie") or []
    return {"Cookie": "; ".join(one.partition(";")[0] for one in cookies)}
