"""A device server that keeps to nothing: memory is bounded, answers are few, no thread dies."""

from __future__ import annotations

import queue
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any, cast

import pytest
import serial
from serial import rfc2217

from analyzer.line import Line
from analyzer.sources.rfc2217 import MAX_ANSWERS, MAX_BLOCKS, BoundedSerial
from tests.support.port_reader import PortReader

IAC, SB, SE, DO, WILL = (bytes([one]) for one in (0xFF, 0xFA, 0xF0, 0xFD, 0xFB))


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[socket.socket, Any]]:
    """The server's end, and a connection whose negotiation is over."""
    ours, theirs = socket.socketpair()
    port: Any = BoundedSerial(None)
    port._socket, port._read_buffer, port.is_open = theirs, queue.Queue(), True
    port._telnet_options, port._rfc2217_options = [], {}
    port._write_lock = threading.Lock()
    theirs.settimeout(0.05)
    port._thread = threading.Thread(target=port._telnet_read_loop, daemon=True)
    port._thread.start()
    with closing(ours), closing(theirs):
        yield ours, port
        port.is_open = False
        port._thread.join(5)
        port._thread = None


def send_for(ours: socket.socket, data: bytes, seconds: float) -> int:
    """Send the same again and again; gives the bytes that were taken."""
    ours.settimeout(0.05)
    sent, until = 0, time.monotonic() + seconds
    while time.monotonic() < until:
        try:
            sent += ours.send(data)
        except TimeoutError:
            continue
        except OSError:
            break
    return sent


def test_data_is_passed_on_without_the_commands(ends: tuple[socket.socket, Any]) -> None:
    """All byte values; FF is doubled on the way."""
    ours, port = ends
    data = bytes(range(256))
    ours.sendall(IAC + b"\xf1" + data.replace(IAC, IAC + IAC))
    got = b""
    while len(got) < len(data):
        got += port._read_buffer.get(timeout=5)
    assert got == data


def test_a_flood_of_data_waits_at_the_server(ends: tuple[socket.socket, Any]) -> None:
    """Nobody reads: the queue is bounded, and TCP holds the rest back."""
    ours, port = ends
    sent = send_for(ours, b"x" * 65536, 1.0)
    assert port._read_buffer.qsize() <= MAX_BLOCKS + 1
    assert sent < 2 << 20


def test_a_flood_of_options_is_answered_a_few_times(
    ends: tuple[socket.socket, Any],
) -> None:
    """Each answer is three bytes."""
    ours, _ = ends
    send_for(ours, (DO + b"\x63" + WILL + b"\x64").join([IAC] * 2) * 100, 0.5)
    ours.settimeout(0.2)
    got = 0
    try:
        while data := ours.recv(65536):
            got += len(data)
    except TimeoutError:
        pass
    assert got <= 3 * MAX_ANSWERS


@pytest.mark.parametrize("data", [IAC + SB + b"x" * 70000, b"\x00" + IAC + SB + b"\x2c\x6b" * 4000])
def test_a_suboption_without_an_end_ends_the_connection(
    ends: tuple[socket.socket, Any], data: bytes
) -> None:
    """It is an end like any other, so that the port is opened again."""
    ours, port = ends
    send_for(ours, data, 0.3)
    port._thread.join(5)
    assert not port._thread.is_alive()


def test_an_end_without_a_beginning_is_ignored(ends: tuple[socket.socket, Any]) -> None:
    """The thread of pyserial dies of it."""
    ours, port = ends
    ours.sendall(IAC + SE + b"abc")
    assert port._read_buffer.get(timeout=5) == b"abc"


class _Writer:
    """What pyserial's server writes its answers to."""

    def __init__(self, peer: socket.socket) -> None:
        self.write = peer.sendall


@pytest.mark.filterwarnings("ignore:set.*is deprecated:DeprecationWarning")  # pyserial's own
def test_a_server_that_keeps_to_it_is_read() -> None:
    """Pyserial's own server: settings are negotiated, then bytes come, and the end is reported."""
    data = bytes(range(256))
    settings: list[tuple[int, str]] = []

    def serve(server: socket.socket) -> None:
        peer, _ = server.accept()
        with closing(peer), closing(serial.serial_for_url("loop://")) as port:
            manager: Any = rfc2217.PortManager(cast(Any, port), cast(Any, _Writer(peer)))
            peer.settimeout(0.5)
            try:
                while received := peer.recv(1024):
                    list(manager.filter(received))
            except TimeoutError:  # the negotiation is over
                settings.append((port.baudrate, port.parity))
                peer.sendall(b"".join(manager.escape(data)))

    with socket.create_server(("127.0.0.1", 0)) as server:
        serving = threading.Thread(target=serve, args=[server], daemon=True)
        serving.start()
        name = f"rfc2217://127.0.0.1:{server.getsockname()[1]}"
        with PortReader(name, Line(19200)) as hearing:
            got = b""
            until = time.monotonic() + 20
            while len(got) < len(data) and time.monotonic() < until:
                got += hearing.read_up_to(len(data) - len(got))
            assert got == data
            assert "lost" in str(hearing.wait_until_lost())
        serving.join(5)
    assert settings == [(19200, "E")]
