"""A pymodbus server that runs beside the script that talks to it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Coroutine, Iterator

from pymodbus.server import ModbusTcpServer

__all__ = ["serving"]

START_S = 5.0


@contextlib.contextmanager
def serving(make: Callable[[], ModbusTcpServer]) -> Iterator[None]:
    """A server in a thread of its own, made there because it belongs to the thread's loop."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def start() -> ModbusTcpServer:
        server = make()
        await server.serve_forever(background=True)
        return server

    server = asyncio.run_coroutine_threadsafe(start(), loop).result(START_S)
    try:
        yield
    finally:
        stop: Callable[[], Coroutine[None, None, None]] = server.shutdown
        asyncio.run_coroutine_threadsafe(stop(), loop).result(START_S)
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
