"""What `bench.network_events` plays: real clients and servers, and what goes wrong between them.

A play asks as long as it is not `over`; its trouble is there while `trouble` is set.
"""

from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import socket
import struct
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerType

from tests.support.middlemen import Middleman

__all__ = ["PLAYS", "Play"]

HOST, TIMEOUT_S, CYCLE_S = "127.0.0.1", 0.25, 0.3
UNIT, CODE = 6, 7
OTHER_UNIT, NOBODY = 2, 255
LISTS = ((1, 0, 6), (1, 10, 4), (2, 20, 8))
"""Unit, address and quantity of what all clients ask."""


def ignore(direction: str, data: bytes) -> None:
    """Take no note."""


class Play:
    """A server at `port`, most with a pymodbus server at the port after it, and clients."""

    code: ClassVar[str]
    clients: ClassVar[Sequence[str]] = ("ask",)

    def __init__(self, port: int) -> None:
        self.port, self.behind = port, port + 1
        self.trouble, self.over = threading.Event(), threading.Event()
        self._middleman: Middleman | None = None

    def begin(self) -> None:
        """Let the clients ask."""
        self.serve()
        for name in self.clients:
            threading.Thread(target=getattr(self, name), daemon=True).start()

    def serve(self) -> None:
        """Open the port that clients ask."""
        play = self

        class Between(Middleman):
            def welcome(self, client: socket.socket) -> bool:
                return play.welcome(client, self._open)

            def answer(self, who: int, answer: bytes) -> bytes | None:
                return play.answer(who, answer) if play.trouble.is_set() else answer

        self._middleman = Between(self.port, self.behind, ignore)

    def end(self) -> None:
        """Close the port."""
        if self._middleman is not None:
            self._middleman.close()

    def welcome(self, client: socket.socket, already: int) -> bool:
        """Whether a client may stay beside those that are there already."""
        return True

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """What is sent in place of an answer, during the trouble."""
        return answer

    def client(self, framer: FramerType = FramerType.SOCKET) -> Any:
        """A pymodbus client."""
        return ModbusTcpClient(HOST, port=self.port, framer=framer, timeout=TIMEOUT_S, retries=0)

    def ask(self) -> None:
        """Ask in turn, and connect again where the connection is lost."""
        client = self.client()
        while not self.over.is_set():
            for unit, address, count in LISTS:
                read(client, unit, address, count)
                time.sleep(CYCLE_S / 3)
        client.close()


def read(client: Any, unit: int, address: int, count: int) -> None:
    """Ask once; pymodbus connects first where it has to."""
    with contextlib.suppress(ModbusException, OSError):
        if client.connected or client.connect():
            client.read_holding_registers(address, count=count, device_id=unit)


class Full(Play):
    """A second client finds no place and is closed at once; without the trouble it has one."""

    code = "connection_limit"
    clients = ("ask", "knock")

    def welcome(self, client: socket.socket, already: int) -> bool:
        """Close the second one."""
        if self.trouble.is_set() and already:
            client.close()
            return False
        return True

    def knock(self) -> None:
        """Connect for each question."""
        while not self.over.is_set():
            client = self.client()
            for unit, address, count in LISTS:
                read(client, unit, address, count)
            client.close()
            time.sleep(1.5)


class OneAtATime(Play):
    """A libmodbus server that serves one client until it leaves; the second one waits in vain."""

    code = "connection_limit"
    clients = ("ask", "wait")

    def serve(self) -> None:
        """Serve with libmodbus."""
        threading.Thread(
            target=serve_one_at_a_time, args=(self.port, self.over), daemon=True
        ).start()
        time.sleep(0.5)

    def wait(self) -> None:
        """A second client during the trouble."""
        while not self.over.is_set():
            if self.trouble.wait(0.5):
                client = self.client()
                for _ in range(3):
                    read(client, 1, 0, 6)
                client.close()
                time.sleep(1.0)


class Down(Play):
    """The server program ends and is started again."""

    code = "device_absent"
    clients = ("ask", "stop")

    def stop(self) -> None:
        """Close listener and connections while the trouble lasts."""
        self.trouble.wait()
        self.end()
        while self.trouble.is_set():
            time.sleep(0.1)
        self.serve()

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """End the connections."""
        raise ConnectionError


class NoAnswerBehind(Play):
    """A gateway cannot reach unit 2 and says so (exception 11)."""

    code = "device_busy"

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """Refuse for unit 2."""
        return refused(answer, 11) if answer[UNIT] == OTHER_UNIT else answer


class Busy(Play):
    """A server is busy every other time (exception 6)."""

    code = "device_busy"

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """Refuse by the transaction identifier."""
        return refused(answer, 6) if answer[1] % 2 else answer


class WrongNumber(Play):
    """A client asks unit 255 as well, which nobody answers."""

    code = "gateway_unit_id"
    clients = ("ask", "ask_255")

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """Drop what is said of unit 255."""
        return None if answer[UNIT] == NOBODY else answer

    def ask_255(self) -> None:
        """Ask now and then."""
        client = self.client()
        while not self.over.is_set():
            if self.trouble.wait(0.5):
                read(client, NOBODY, 0, 6)
                time.sleep(0.5)
        client.close()


class Late(Play):
    """Two of three answers come when the client has given up."""

    code = "slow_answers"

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """Wait longer than the client does."""
        if answer[1] % 3:
            time.sleep(TIMEOUT_S * 4)
        return answer


class Behind(Play):
    """A gateway gives each answer to the next request, under its identifier; libmodbus asks."""

    code = "lockstep"
    clients = ("ask_with_libmodbus",)
    kept: bytes | None = None

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """The answer before."""
        kept, self.kept = self.kept, answer
        return None if kept is None else answer[:2] + kept[2:]

    def ask_with_libmodbus(self) -> None:
        """Ask in turn on one connection."""
        ask_with_libmodbus(self.port, self.over)


class BehindById(Behind):
    """The same under the identifier of the request that it answers; pymodbus asks."""

    clients = ("ask",)

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """The answer before."""
        kept, self.kept = self.kept, answer
        return kept


class OtherFraming(Play):
    """A client with RTU frames asks a server of Modbus/TCP."""

    code = "framing_mismatch"
    clients = ("ask", "ask_in_rtu")

    def ask_in_rtu(self) -> None:
        """Ask on a connection that lasts as long as the trouble."""
        while not self.over.is_set():
            if self.trouble.wait(0.5):
                client = self.client(FramerType.RTU)
                while self.trouble.is_set():
                    read(client, 1, 0, 6)
                    time.sleep(0.5)
                client.close()


class ShortPatience(Play):
    """A server closes a connection after each answer."""

    code = "connection_churn"

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """End the connection now and then."""
        if answer[1] % 4 == 0:
            raise ConnectionError
        return answer


class Mixed(Play):
    """A gateway gives each fourth request the latest answer of the other client."""

    code = "gateway_mixup"
    clients = ("ask", "ask_unit_2")

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self._latest: dict[int, bytes] = {}

    def ask_unit_2(self) -> None:
        """Ask for something else."""
        client = self.client()
        while not self.over.is_set():
            read(client, 2, 30, 5)
            time.sleep(CYCLE_S / 2)
        client.close()

    def answer(self, who: int, answer: bytes) -> bytes | None:
        """Its own, or the other one's."""
        other = next((last for client, last in self._latest.items() if client != who), None)
        self._latest[who] = answer
        return answer[:2] + other[2:] if other is not None and answer[1] % 4 == 0 else answer


def refused(answer: bytes, exception: int) -> bytes:
    """An exception in place of an answer."""
    return answer[:4] + struct.pack(">HBBB", 3, answer[UNIT], answer[CODE] | 0x80, exception)


def library() -> Any:
    """The shared library of libmodbus."""
    found = ctypes.CDLL(ctypes.util.find_library("modbus"))
    found.modbus_new_tcp.restype = ctypes.c_void_p
    found.modbus_mapping_new.restype = ctypes.c_void_p
    return found


def serve_one_at_a_time(port: int, over: threading.Event) -> None:
    """Accept a client, answer it until it leaves, and accept the next one."""
    lib = library()
    context = ctypes.c_void_p(lib.modbus_new_tcp(HOST.encode(), port))
    mapping = ctypes.c_void_p(lib.modbus_mapping_new(100, 100, 100, 100))
    listener = ctypes.c_int(lib.modbus_tcp_listen(context, 5))
    query = (ctypes.c_uint8 * 260)()
    while not over.is_set():
        lib.modbus_tcp_accept(context, ctypes.byref(listener))
        while (length := lib.modbus_receive(context, query)) >= 0:
            lib.modbus_reply(context, query, length, mapping)


def ask_with_libmodbus(port: int, over: threading.Event) -> None:
    """Ask the lists in turn; what does not fit is discarded, and the connection stays."""
    lib = library()
    context = ctypes.c_void_p(lib.modbus_new_tcp(HOST.encode(), port))
    lib.modbus_set_response_timeout(context, 0, int(TIMEOUT_S * 1e6))
    lib.modbus_connect(context)
    values = (ctypes.c_uint16 * 125)()
    while not over.is_set():
        for unit, address, count in LISTS:
            lib.modbus_set_slave(context, unit)
            lib.modbus_read_registers(context, address, count, values)
            time.sleep(CYCLE_S / 3)
    lib.modbus_close(context)


PLAYS: Mapping[str, type[Play]] = {
    "full": Full,
    "one_at_a_time": OneAtATime,
    "down": Down,
    "no_answer_behind": NoAnswerBehind,
    "busy": Busy,
    "wrong_number": WrongNumber,
    "late": Late,
    "behind": Behind,
    "behind_by_id": BehindById,
    "other_framing": OtherFraming,
    "short_patience": ShortPatience,
    "mixed": Mixed,
}
