"""A serial proxy of ESPHome: what is heard is decoded, and nothing is written."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import importlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

pytest.importorskip("aioesphomeapi")

from aioesphomeapi.core import MESSAGE_TYPE_TO_PROTO

from analyzer import PortError, UsageError
from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from analyzer.sources.esphome import KEY, open_port
from tests.support.ptybus import PtyBus
from tests.support.side_by_side import MASTER, UNIT, WHOLE, Heard, differences, poll

messages: Any = importlib.import_module("aioesphomeapi.api_pb2")
NUMBERS = {kind.__name__: number for number, kind in MESSAGE_TYPE_TO_PROTO.items()}
EXCHANGE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
PASSIVE = {
    "HelloRequest", "AuthenticationRequest", "DeviceInfoRequest", "PingRequest", "PingResponse",
    "DisconnectRequest", "SerialProxyRequest", "SerialProxyConfigureRequest",
}  # fmt: skip
"""What a listener may send: nothing that writes, sets modem pins or the mode."""


class Plain:
    """How messages are framed on a connection without encryption."""

    async def greet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Nothing comes before the messages."""

    async def read(self, reader: asyncio.StreamReader) -> tuple[int, bytes]:
        """Number and content of the next message."""
        await reader.readexactly(1)
        length, number = await varint(reader), await varint(reader)
        return number, await reader.readexactly(length)

    def pack(self, number: int, data: bytes) -> bytes:
        """A message as it is sent."""
        return b"\0" + as_varint(len(data)) + as_varint(number) + data


class Noise(Plain):
    """The device's side of ESPHome's encryption: Noise_NNpsk0_25519_ChaChaPoly_SHA256."""

    def __init__(self, key: str) -> None:
        kind = importlib.import_module("noise.connection").NoiseConnection
        self._noise: Any = kind.from_name(b"Noise_NNpsk0_25519_ChaChaPoly_SHA256")
        self._noise.set_as_responder()
        self._noise.set_psks(base64.b64decode(key))
        self._noise.set_prologue(b"NoiseAPIInit\0\0")
        self._noise.start_handshake()

    async def greet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """The handshake; a client with another key is refused as the firmware does."""
        try:
            await self._frame(reader)
        except AssertionError as error:
            writer.write(self._framed(b"\1Bad indicator byte"))
            raise ConnectionError from error
        writer.write(self._framed(b"\1meter\0"))
        try:
            self._noise.read_message((await self._frame(reader))[1:])
        except importlib.import_module("cryptography.exceptions").InvalidTag as error:
            writer.write(self._framed(b"\1Handshake MAC failure"))
            raise ConnectionError from error
        writer.write(self._framed(b"\0" + bytes(self._noise.write_message())))

    async def read(self, reader: asyncio.StreamReader) -> tuple[int, bytes]:
        """Number and content of the next message."""
        data = bytes(self._noise.decrypt(await self._frame(reader)))
        return int.from_bytes(data[:2], "big"), data[4:]

    def pack(self, number: int, data: bytes) -> bytes:
        """A message as it is sent."""
        head = number.to_bytes(2, "big") + len(data).to_bytes(2, "big")
        return self._framed(bytes(self._noise.encrypt(head + data)))

    async def _frame(self, reader: asyncio.StreamReader) -> bytes:
        assert await reader.readexactly(1) == b"\1"
        return await reader.readexactly(int.from_bytes(await reader.readexactly(2), "big"))

    def _framed(self, data: bytes) -> bytes:
        return b"\1" + len(data).to_bytes(2, "big") + data


class Device:
    """The API of a device on loopback, in a thread; it notes every message it gets."""

    def __init__(
        self,
        *,
        names: tuple[str, ...] = ("meter",),
        status: int = 0,
        key: str | None = None,
        api: int = 18,
    ) -> None:
        self._key, self._api = key, api
        self._framing: dict[asyncio.StreamWriter, Plain] = {}
        self.got: list[tuple[str, Any]] = []
        self._names, self._status = names, status
        self._writers: list[asyncio.StreamWriter] = []
        self._tasks: list[asyncio.Task[Any]] = []
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._server = self._do(asyncio.start_server(self._serve, "127.0.0.1", 0))
        self.port = self._server.sockets[0].getsockname()[1]

    def send(self, data: bytes) -> None:
        """Bytes from the line."""
        self._loop.call_soon_threadsafe(
            self._write, messages.SerialProxyDataReceived(instance=0, data=data)
        )

    def drop(self) -> None:
        """Close the connections, as a device that restarts."""
        for one in list(self._writers):
            self._loop.call_soon_threadsafe(one.close)

    def close(self) -> None:
        """Stop serving."""
        self._do(self._end())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        for task in list(self._tasks):
            task.cancel()
        for writer in list(self._writers):
            writer.close()
        await asyncio.sleep(0.05)

    def _do(self, work: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(10)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        task = asyncio.current_task()
        assert task is not None
        self._tasks.append(task)
        framing = Plain() if self._key is None else Noise(self._key)
        try:
            await framing.greet(reader, writer)
            self._framing[writer] = framing
            while True:
                number, data = await framing.read(reader)
                kind = MESSAGE_TYPE_TO_PROTO[number]
                message = kind.FromString(data)
                self.got.append((kind.__name__, message))
                for answer in self._answers(kind.__name__, message):
                    self._write(answer)
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            writer.close()
            self._framing.pop(writer, None)
            self._writers.remove(writer)

    def _answers(self, kind: str, message: Any) -> Iterator[Any]:
        if kind == "HelloRequest":
            yield messages.HelloResponse(
                api_version_major=1, api_version_minor=self._api, name="meter"
            )
        elif kind == "AuthenticationRequest":
            yield messages.AuthenticationResponse()
        elif kind == "DeviceInfoRequest":
            proxies = [messages.SerialProxyInfo(name=name) for name in self._names]
            yield messages.DeviceInfoResponse(name="meter", serial_proxies=proxies)
        elif kind == "SerialProxyRequest":
            yield messages.SerialProxyRequestResponse(
                instance=message.instance, type=message.type, status=self._status
            )
        elif kind == "PingRequest":
            yield messages.PingResponse()
        elif kind == "DisconnectRequest":
            yield messages.DisconnectResponse()

    def _write(self, message: Any) -> None:
        data, number = message.SerializeToString(), NUMBERS[type(message).__name__]
        for writer, framing in self._framing.items():
            writer.write(framing.pack(number, data))


async def varint(reader: asyncio.StreamReader) -> int:
    value = shift = 0
    while True:
        (byte,) = await reader.readexactly(1)
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value


def as_varint(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


@pytest.fixture
def device() -> Iterator[Device]:
    one = Device()
    yield one
    one.close()


def rows_until(run: LiveRun, count: int, act: Callable[[], None]) -> list[Any]:
    """Do something, and give the next transactions."""
    act()
    found: list[Any] = []
    for turn, batch in enumerate(run.batches()):
        found += batch.transactions
        if len(found) >= count:
            return found
        assert turn < 400, "no rows for 20 s"
    return found


def test_rows_are_decoded_and_nothing_is_written(device: Device) -> None:
    """Over three connections; the device's record has no message that could reach the line."""
    said: list[str] = []
    name = f"esphome://127.0.0.1:{device.port}/meter@9600-8N1"
    with closing(LiveRun([name], Settings(), notify=said.append)) as run:
        for restart in range(3):

            def exchange() -> None:
                for part in EXCHANGE:
                    device.send(part)

            (row,) = rows_until(run, 1, exchange)
            assert (row.unit, row.status, row.data) == (1, "ok", [7])
            if restart < 2:
                device.drop()
                for _ in run.batches():
                    if sum("back after" in text for text in said) > restart:
                        break
    kinds = {kind for kind, _ in device.got}
    assert kinds <= PASSIVE
    configured = [one for kind, one in device.got if kind == "SerialProxyConfigureRequest"]
    assert [(one.baudrate, one.data_size, one.stop_bits) for one in configured] == [
        (9600, 8, 1)
    ] * 3


def test_rows_are_those_of_the_line_row_by_row_over_three_reconnects(device: Device) -> None:
    """Traffic of the pty bus: what the proxy passes on gives the rows of a tap on the line."""
    with PtyBus([MASTER, UNIT, "tap", "proxy"], 19200, 10, trigger=WHOLE) as bus:
        proxy = os.open(bus.path("proxy"), os.O_RDWR | os.O_NOCTTY)

        def pass_on() -> None:
            with contextlib.suppress(OSError):
                while data := os.read(proxy, 256):
                    device.send(data)
            os.close(proxy)

        threading.Thread(target=pass_on, daemon=True).start()
        drops = [1.0, 2.5, 4.0]

        def drop_when_due(seconds: float) -> None:
            if drops and seconds > drops[0]:
                drops.pop(0)
                device.drop()

        name = f"esphome://127.0.0.1:{device.port}/meter@19200-8N1"
        with Heard(f"{bus.path('tap')}@19200-8N1") as direct, Heard(name) as other:
            count = poll(bus, seconds=6.0, between=drop_when_due)
            direct.wait_for(count - 1)
            time.sleep(1.0)
        senders = {sent.sender for sent in bus.truth}
    assert len(direct.rows) == count > 50
    assert other.returned() == 3
    # Where the connection was away, half of an exchange may have been heard.
    answered = ("ok", "exception")
    lines = [[row for row in one.rows if row[-1] in answered] for one in (direct, other)]
    found = differences(*lines)
    assert found.is_in_order
    assert found.extra == []
    assert found.holes <= 3
    assert len(found.missing) < count / 2
    others = {row[-1] for row in other.rows} - set(answered)
    assert others <= {"unsolicited", "not_observed", "no_response"}
    assert senders == {MASTER, UNIT}
    assert {kind for kind, _ in device.got} <= PASSIVE


def test_an_encrypted_connection_needs_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it, and with a wrong one, the error says where it goes; with it rows come."""
    keys = [base64.b64encode(bytes([number]) * 32).decode() for number in (1, 2)]
    device = Device(key=keys[0])
    name = f"esphome://127.0.0.1:{device.port}/meter"
    for wrong in ("", keys[1]):
        monkeypatch.setenv(KEY, wrong)
        with pytest.raises(PortError, match=KEY):
            open_port(name, None)
    monkeypatch.setenv(KEY, keys[0])
    with closing(LiveRun([f"{name}@9600-8N1"], Settings())) as run:
        (row,) = rows_until(run, 1, lambda: device.send(b"".join(EXCHANGE)))
        assert (row.unit, row.status, row.data) == (1, "ok", [7])
    device.close()
    assert {kind for kind, _ in device.got} <= PASSIVE


def test_settings_are_left_alone_unless_they_are_given(device: Device) -> None:
    """Nor is the name needed where there is one proxy only."""
    open_port(f"esphome://127.0.0.1:{device.port}", None).close()
    assert "SerialProxyConfigureRequest" not in {kind for kind, _ in device.got}


def test_a_second_subscriber_is_told_why_it_is_refused() -> None:
    """ESPHome allows one (PORT_IN_USE)."""
    device = Device(status=5)
    with pytest.raises(PortError, match="another client is subscribed, and ESPHome allows one"):
        open_port(f"esphome://127.0.0.1:{device.port}/meter", None)
    device.close()


def test_old_firmware_refuses_in_silence_so_a_note_says_what_to_try() -> None:
    """A host build of ESPHome 2026.6 ignored the second subscriber."""
    device = Device(api=14)
    with closing(open_port(f"esphome://127.0.0.1:{device.port}/meter", None)) as port:
        assert "stop the other client" in port.advice
    device.close()


@pytest.mark.parametrize(
    ("names", "wanted", "words"),
    [((), "", "has no serial_proxy"), (("a", "b"), "c", "no serial proxy 'c'; there are a, b")],
)
def test_the_names_of_proxies_are_told(names: tuple[str, ...], wanted: str, words: str) -> None:
    device = Device(names=names)
    with pytest.raises(PortError, match=words):
        open_port(f"esphome://127.0.0.1:{device.port}/{wanted}", None)
    device.close()


def test_a_device_that_is_not_there_is_an_error() -> None:
    device = Device()
    device.close()
    with pytest.raises(PortError, match=r"cannot be reached: [A-Z]|no answer"):
        open_port("esphome://127.0.0.1:1/meter", None)


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "aioesphomeapi", None)
    with pytest.raises(UsageError, match=r"needs a package: .*aioesphomeapi"):
        open_port("esphome://127.0.0.1/meter", None)
