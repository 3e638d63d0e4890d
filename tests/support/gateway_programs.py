"""Programs that are gateways: pymodbus's own server and client, mbusd, modbus-proxy.

Each is a context that gives the port of its Modbus/TCP side; `path` is its serial line.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import subprocess
import time
from collections.abc import Iterator

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.datastore import ModbusDeviceContext, ModbusServerContext
from pymodbus.framer import FramerType
from pymodbus.server import ModbusTcpServer

from tests.support.pymodbus_server import serving

__all__ = ["GATEWAYS", "free_port"]


def free_port() -> int:
    """A port that nobody uses."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        found: int = listener.getsockname()[1]
        return found


class Forwarding(ModbusServerContext):
    """A pymodbus server whose registers are those of a device on a serial line.

    The pty has no parity: parity bits are the line's.
    """

    def __init__(self, path: str) -> None:
        super().__init__(devices=ModbusDeviceContext())
        # With a context of the new kind the server would not ask this object.
        self.old_simulator, self.simdevices = True, []
        self._path = path
        self._client: AsyncModbusSerialClient | None = None
        self._lock = asyncio.Lock()

    async def async_getValues(  # noqa: N802 - pymodbus's name
        self, device_id: int, func_code: int, address: int, count: int = 1
    ) -> list[int]:
        """Ask on the line; one request at a time."""
        async with self._lock:
            if self._client is None:
                self._client = AsyncModbusSerialClient(
                    self._path, framer=FramerType.RTU, baudrate=19200, timeout=1
                )
                await self._client.connect()
            found = await self._client.read_holding_registers(
                address, count=count, device_id=device_id
            )
            return list(found.registers)


@contextlib.contextmanager
def pymodbus_gateway(path: str, program: str | None) -> Iterator[int]:
    """A gateway of pymodbus's server and client."""
    port = free_port()
    with serving(lambda: ModbusTcpServer(Forwarding(path), address=("127.0.0.1", port))):
        yield port


@contextlib.contextmanager
def mbusd(path: str, program: str | None) -> Iterator[int]:
    """The gateway of github.com/3cky/mbusd."""
    port = free_port()
    words = ("-d", "-L", "-", "-v", "0", "-p", path, "-s", "19200", "-m", "8e1")
    more = ("-A", "127.0.0.1", "-P", str(port), "-R", "5", "-W", "500", "-N", "0")
    with running([program or "mbusd", *words, *more], port):
        yield port


@contextlib.contextmanager
def modbus_proxy(path: str, program: str | None) -> Iterator[int]:
    """The gateway of the package modbus-proxy; `path` is the port of the device."""
    port = free_port()
    words = ("-b", f"tcp://127.0.0.1:{port}", "--modbus", f"tcp://127.0.0.1:{path}")
    with running([program or "modbus-proxy", *words], port):
        yield port


GATEWAYS = {"pymodbus": pymodbus_gateway, "mbusd": mbusd, "modbus-proxy": modbus_proxy}


@contextlib.contextmanager
def running(command: list[str], port: int) -> Iterator[None]:
    """Run a program that serves a port, from when it listens."""
    program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_for(port)
        yield
    finally:
        program.terminate()
        program.wait()


def wait_for(port: int) -> None:
    """Wait until a server listens; `TimeoutError` after ten seconds."""
    end = time.monotonic() + 10
    while time.monotonic() < end:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return
        time.sleep(0.05)
    raise TimeoutError(f"nothing listens on port {port}")
