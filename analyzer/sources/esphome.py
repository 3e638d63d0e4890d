"""Serial proxies of ESPHome: `esphome://host[:port]/NAME`.

ESPHome gives the bytes of a UART to one subscriber (2026.3 and later). This client subscribes and
sends the line settings, where they are given. It never sends the message that writes to the line,
nor one that sets modem pins or the mode; a test keeps a record of every message. The key of an
encrypted connection comes from the environment, where other users cannot read it.

https://esphome.io/components/serial_proxy/
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import threading
from collections.abc import Mapping
from typing import Any
from urllib.parse import unquote, urlsplit

from _modlens import Inbox
from analyzer.installing import how_to_install
from analyzer.line import parse_line
from analyzer.sources.schemes import LivePort
from dissectors.errors import PortError, UsageError

__all__ = ["KEY", "open_port"]

KEY = "MODLENS_ESPHOME_KEY"
"""The environment variable with the key of the device's API (`api: encryption: key:`)."""

_PORT = 6053
_PATIENCE_S = 20.0
_PARITIES = {"N": "NONE", "E": "EVEN", "O": "ODD"}


def open_port(name: str, settings: str | None) -> LivePort:
    """Subscribe to the serial proxy of this name; it may be left out where there is only one.

    `PortError` if that is not possible, `UsageError` without the package aioesphomeapi.
    """
    try:
        import aioesphomeapi  # noqa: F401, PLC0415 - a second, for those who use it
    except ImportError as error:
        raise UsageError(f"{name} needs a package: {how_to_install('aioesphomeapi')}") from error
    return _ProxyPort(name, settings)


class _ProxyPort:
    """A subscription, in a thread of its own; a `schemes.LivePort`."""

    takes_line_settings = True
    marks_errors = False

    def __init__(self, name: str, settings: str | None) -> None:
        self.advice = ""
        self._name = name
        self._lock = threading.Lock()
        self._heard: list[bytes | None] = []
        self._inbox: Inbox | None = None
        self._number = self._instance = 0
        self._loop = asyncio.new_event_loop()
        self._client: Any = None
        self._thread = threading.Thread(target=self._loop.run_forever, name=name, daemon=True)
        self._thread.start()
        try:
            self._run(self._subscribe())
            if settings is not None:
                self.set_line(settings)
        except BaseException:
            self.close()
            raise

    def listen(self, inbox: Inbox, number: int) -> None:
        """Pass the reads to the inbox, those since the subscription first."""
        with self._lock:
            self._inbox, self._number = inbox, number
            for data in self._heard:
                inbox.put(number, data)
            self._heard.clear()

    def set_line(self, line: str) -> None:
        """Tell the device the settings of its UART."""
        self._run(self._configure(line))

    def counters(self) -> Mapping[str, int]:
        """No error counters: the proxy has none."""
        return {}

    def stop(self) -> None:
        """End the subscription; nothing is passed on any more."""
        with self._lock:
            self._inbox = None

    def close(self) -> None:
        """Disconnect, and end the thread."""
        self.stop()
        if not self._thread.is_alive():
            return
        with contextlib.suppress(TimeoutError):
            asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(_PATIENCE_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _run(self, work: Any) -> None:
        """Have the thread do something; its errors are `PortError` with what to do."""
        from aioesphomeapi.core import APIConnectionError  # noqa: PLC0415

        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            future.result(_PATIENCE_S)
        except (APIConnectionError, OSError, TimeoutError) as error:
            raise PortError(_advice(error), port=self._name) from error

    async def _subscribe(self) -> None:
        from aioesphomeapi.client import APIClient  # noqa: PLC0415
        from aioesphomeapi.model import SerialProxyStatus  # noqa: PLC0415

        place = urlsplit(self._name)
        self._client = APIClient(
            place.hostname or "",
            place.port or _PORT,
            client_info="modlens",
            noise_psk=os.environ.get(KEY) or None,
            provide_time=False,
        )
        await self._client.connect(on_stop=self._on_stop, login=True, log_errors=False)
        about = await self._client.device_info()
        self._instance = self._instance_of(unquote(place.path.strip("/")), about.serial_proxies)
        self._client.subscribe_serial_proxy_data(self._on_data)
        answer = await self._client.serial_proxy_subscribe_await_response(self._instance)
        if answer is None:  # firmware before API 1.16 does not answer
            self.advice = (
                "this ESPHome does not report a refused subscription, and allows one; if nothing is"
                " received, stop the other client, such as Home Assistant's integration"
            )
            return
        if answer.status in (
            SerialProxyStatus.OK,
            SerialProxyStatus.ASSUMED_SUCCESS,
        ):
            return
        if answer.status == SerialProxyStatus.PORT_IN_USE:
            raise PortError(
                "another client is subscribed, and ESPHome allows one; stop that one (such as Home"
                " Assistant's integration)",
                port=self._name,
            )
        reason = answer.error_message or str(getattr(answer.status, "name", answer.status))
        raise PortError(f"the device refused the subscription: {reason}", port=self._name)

    def _instance_of(self, wanted: str, proxies: Any) -> int:
        names = [one.name for one in proxies]
        if not names:
            raise PortError(
                "this ESPHome device has no serial_proxy; it needs ESPHome 2026.3 or later and the"
                " component in its configuration",
                port=self._name,
            )
        if wanted in names:
            return names.index(wanted)
        if not wanted and len(names) == 1:
            return 0
        raise PortError(
            f"no serial proxy {wanted!r}; there are {', '.join(names)}", port=self._name
        )

    async def _end(self) -> None:
        """Disconnect, and wait for what the client has left to do."""
        if self._client is not None:
            self._client.force_disconnect()
        await asyncio.sleep(0)
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _configure(self, settings: str) -> None:
        from aioesphomeapi.model import SerialProxyParity  # noqa: PLC0415

        line = parse_line(settings)
        if line.parity not in _PARITIES or line.stop_bits not in (1, 2):
            raise PortError(f"ESPHome does not take the settings {settings}", port=self._name)
        self._client.serial_proxy_configure(
            self._instance,
            line.baud,
            parity=SerialProxyParity[_PARITIES[line.parity]],
            stop_bits=int(line.stop_bits),
            data_size=line.data_bits,
        )

    def _on_data(self, received: Any) -> None:
        if received.instance == self._instance and received.data:
            self._pass_on(bytes(received.data))

    async def _on_stop(self, expected: bool) -> None:
        self._pass_on(None)

    def _pass_on(self, data: bytes | None) -> None:
        """Pass a read to the inbox, None for the end; keep it until somebody listens."""
        with self._lock:
            if self._inbox is not None:
                self._inbox.put(self._number, data)
            else:
                self._heard.append(data)


def _advice(error: Exception) -> str:
    """The text of an error of the connection, with what to do about it."""
    kind = type(error).__name__
    if "Encryption" in kind:
        return f"the connection is encrypted: put the key of the device's API into {KEY}"
    if isinstance(error, TimeoutError):
        return "no answer; check the address, and that the device has api: in its configuration"
    # The client's text has its whole list of addresses.
    number = re.search(r"\[Errno (\d+)\]", str(error))
    return f"cannot be reached: {error if number is None else os.strerror(int(number[1]))}"
