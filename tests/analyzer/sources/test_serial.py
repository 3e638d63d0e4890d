"""A serial port that only listens, on pseudo terminals."""

from __future__ import annotations

import ast
import os
import select
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from analyzer import PortError, UsageError
from analyzer.line import Line
from analyzer.sources import serial as serial_module
from analyzer.sources.serial import Clock, Port

if sys.platform == "win32":
    pytest.skip("pseudo terminals", allow_module_level=True)

import pty
import tty

LINE = Line(19200)
DATA = bytes(range(256))


@pytest.fixture
def wire() -> Iterator[tuple[int, str]]:
    """The far end of a line, and the name of the port at the near end."""
    far, near = pty.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    os.close(far)
    os.close(near)


def nothing_arrived(far: int) -> bool:
    """Whether the far end has nothing to read."""
    return not select.select([far], [], [], 0.05)[0]


def test_bytes_arrive_with_the_time_of_their_read(wire: tuple[int, str]) -> None:
    """All 256 of them, unchanged; the time is that of the read."""
    far, name = wire
    with Port(name, LINE) as port:
        before = time.time_ns()
        os.write(far, DATA)
        chunk = port.read(1.0)
        after = time.time_ns()
    assert chunk is not None
    assert chunk.data == DATA
    assert before <= chunk.time_ns <= after


def test_silence_is_none(wire: tuple[int, str]) -> None:
    """After as long as one is willing to wait."""
    with Port(wire[1], LINE) as port:
        start = time.monotonic()
        assert port.read(0.05) is None
        assert time.monotonic() - start >= 0.05


def test_nothing_is_ever_sent(wire: tuple[int, str]) -> None:
    """Not on opening, not while reading, not on closing; not even an echo of what comes in."""
    far, name = wire
    port = Port(name, LINE)
    assert nothing_arrived(far)
    for _ in range(3):
        os.write(far, DATA + b"\r\n\x11\x13\x03\x04")
        assert port.read(1.0) is not None
        assert nothing_arrived(far)
    port.close()
    assert nothing_arrived(far)


def test_there_is_no_way_to_send() -> None:
    """No call in the sources package writes, and the port offers none."""
    folder = Path(serial_module.__file__).parent
    forbidden = {"write", "writelines", "send", "sendall", "sendto", "send_break", "sendfile"}
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute):
                assert node.attr not in forbidden, f"{path}:{node.lineno}: {node.attr}"
    assert not forbidden.intersection(dir(Port))


def test_the_driver_is_never_enabled(
    monkeypatch: pytest.MonkeyPatch, wire: tuple[int, str]
) -> None:
    """DTR and RTS are inactive before the port is opened, because adapters transmit by them."""
    lines: list[tuple[bool, bool]] = []
    really_open = serial.Serial.open

    def note(port: serial.Serial) -> None:
        lines.append((port.dtr, port.rts))
        really_open(port)

    monkeypatch.setattr(serial.Serial, "open", note)
    Port(wire[1], LINE).close()
    assert lines == [(False, False)]


def test_a_port_is_opened_exclusively(wire: tuple[int, str]) -> None:
    """A second program is told; after the first has gone it may."""
    _, name = wire
    with Port(name, LINE), pytest.raises(PortError, match="in use by another program"):
        Port(name, LINE)
    Port(name, LINE).close()


def test_a_lost_port_is_told(wire: tuple[int, str]) -> None:
    """The adapter is pulled out: the reader hears of it at once."""
    far, near = pty.openpty()
    port = Port(os.ttyname(near), LINE)
    os.close(near)
    os.close(far)
    with pytest.raises(PortError, match="the port was lost"):
        port.read(1.0)
    port.close()


def refused(name: str) -> str:
    """What is said when this cannot be opened."""
    with pytest.raises(PortError) as caught:
        Port(name, LINE)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_no_port(tmp_path: Path) -> None:
    """Missing, a plain file, a directory."""
    (tmp_path / "file").touch()
    assert refused(str(tmp_path / "ttyX")).endswith("no such port; check the name and the cable")
    assert "not a serial port" in refused(str(tmp_path / "file"))
    assert refused(str(tmp_path)).startswith(str(tmp_path))


def test_an_unknown_scheme_is_wrong_use() -> None:
    """With the known ones."""
    with pytest.raises(UsageError, match=r"tcp://x: no port of a known kind; there are /dev"):
        Port("tcp://x", LINE)
    with pytest.raises(PortError):
        Port("socket://", LINE)


def test_a_socket_is_a_port() -> None:
    """A device server: bytes in, nothing out, and its end is told."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        name = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with Port(name, LINE) as port:
            peer, _ = server.accept()
            peer.sendall(DATA)
            chunk = port.read(1.0)
            assert chunk is not None
            assert chunk.data == DATA
            assert not select.select([peer], [], [], 0.05)[0]
            peer.close()
            with pytest.raises(PortError, match="lost"):
                port.read(1.0)
    assert "refused" in refused(name)


def test_a_port_can_be_closed_while_it_is_read(wire: tuple[int, str]) -> None:
    """Waiting has an end: the thread that reads comes back after its patience."""
    with Port(wire[1], LINE) as port:
        reader = threading.Thread(target=port.read, args=(0.05,))
        reader.start()
        reader.join(2.0)
        assert not reader.is_alive()


def test_the_clock_never_runs_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small corrections of the wall clock do not show, jumps forward do."""
    wall, steady = [1_000 * 10**9], [5 * 10**9]
    monkeypatch.setattr(time, "time_ns", lambda: wall[0])
    monkeypatch.setattr(time, "monotonic_ns", lambda: steady[0])
    clock = Clock()
    assert clock.now_ns() == wall[0]
    steady[0] += 10**9
    wall[0] += 10**9 + 400_000_000  # a correction
    assert clock.now_ns() == 1_001 * 10**9
    wall[0] -= 3600 * 10**9  # set back an hour
    assert clock.now_ns() == 1_001 * 10**9
    wall[0] = 5_000 * 10**9  # woken from sleep
    assert clock.now_ns() == 5_000 * 10**9
