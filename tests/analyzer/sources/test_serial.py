"""A serial port that only listens, on pseudo terminals."""

from __future__ import annotations

import ast
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import serial

from _modlens import Inbox
from analyzer import PortError, UsageError
from analyzer.line import Line
from analyzer.sources import serial as serial_module
from analyzer.sources.schemes import open_port
from tests.support.port_reader import PortReader

if sys.platform == "win32":
    pytest.skip("pseudo terminals", allow_module_level=True)

import pty
import tty

LINE = Line(19200)
DATA = bytes(range(256))
WRITER = """
import os, sys, time
for _ in range(20):
    print(time.clock_gettime_ns(time.CLOCK_MONOTONIC))
    os.write(int(sys.argv[1]), b"x")
    time.sleep(0.01)
"""


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
    """All 256 of them, unchanged, FF among them; the time is that of the read."""
    far, name = wire
    with PortReader(name, LINE) as hearing:
        before = hearing.now_ns()
        os.write(far, DATA)
        read = hearing.read()
        after = hearing.now_ns()
    assert read is not None
    assert (read[0], read[2]) == (DATA, [])
    assert before <= read[1] <= after


def test_a_time_does_not_wait_for_python(wire: tuple[int, str]) -> None:
    """The interpreter is kept busy while bytes come in; their times are those of their writes."""
    far, name = wire
    written: list[int] = []
    with PortReader(name, LINE) as hearing:
        until = time.monotonic_ns() + 200_000_000
        shift_ns = hearing.now_ns() - time.monotonic_ns()
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(far)], pass_fds=[far], stdout=subprocess.PIPE
        )
        while writer.poll() is None or time.monotonic_ns() < until:
            sum(range(1000))  # holds Python's lock
        assert writer.stdout is not None
        written = [int(word) for word in writer.stdout.read().split()]
        writer.stdout.close()
        read = []
        while (one := hearing.read(0.1)) is not None:
            read += [one[1] - shift_ns] * len(
                one[0]
            )  # on a busy machine one read may hold two writes
    late = sorted(got - sent for got, sent in zip(read, written, strict=True))
    assert late[len(late) // 2] < 4_000_000  # Python changes threads every 5 ms


def test_silence_is_nothing(wire: tuple[int, str]) -> None:
    """A silent port gives nothing until the timeout."""
    with PortReader(wire[1], LINE) as hearing:
        start = time.monotonic()
        assert hearing.read(0.05) is None
        assert time.monotonic() - start >= 0.05


def test_nothing_is_ever_sent(wire: tuple[int, str]) -> None:
    """Not on opening, not while reading, not on closing; not even an echo of what comes in."""
    far, name = wire
    with PortReader(name, LINE) as hearing:
        assert nothing_arrived(far)
        for _ in range(3):
            os.write(far, DATA + b"\r\n\x11\x13\x03\x04")
            assert hearing.read() is not None
            assert nothing_arrived(far)
    assert nothing_arrived(far)


def test_there_is_no_way_to_send(wire: tuple[int, str]) -> None:
    """No call in the sources package writes, and the port offers none.

    But for the commands that start and stop the sniffer of a gateway (test_wb_mge.py sees them).
    """
    folder = Path(serial_module.__file__).parent
    forbidden = {"write", "writelines", "send", "sendall", "sendto", "send_break", "sendfile"}
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute):
                if (path.name, node.attr) == ("wb_mge.py", "send"):
                    continue
                assert node.attr not in forbidden, f"{path}:{node.lineno}: {node.attr}"
    with closing(open_port(wire[1], str(LINE))) as port:
        assert not forbidden.intersection(dir(port))


def test_pyserial_never_enables_the_driver(
    monkeypatch: pytest.MonkeyPatch, wire: tuple[int, str]
) -> None:
    """DTR and RTS are inactive before a port is opened where pyserial opens it."""
    lines: list[tuple[bool, bool]] = []
    really_open = serial.Serial.open

    def note(port: serial.Serial) -> None:
        lines.append((port.dtr, port.rts))
        really_open(port)

    monkeypatch.setattr(serial.Serial, "open", note)
    monkeypatch.setattr(sys, "platform", "elsewhere")
    open_port(wire[1], "19200-8N1").close()
    assert lines == [(False, False)]


def test_a_port_is_opened_exclusively(wire: tuple[int, str]) -> None:
    """A second program gets an error until the first has closed the port."""
    _, name = wire
    with (
        closing(open_port(name, str(LINE))),
        pytest.raises(PortError, match="in use by another program"),
    ):
        open_port(name, str(LINE))
    open_port(name, str(LINE)).close()


def test_a_lost_port_is_reported(wire: tuple[int, str]) -> None:
    """If the adapter is unplugged, the reader gets an error at once."""
    far, near = pty.openpty()
    with PortReader(os.ttyname(near), LINE) as hearing:
        os.close(near)
        os.close(far)
        assert "the port was lost" in str(hearing.wait_until_lost())


def refused(name: str) -> str:
    """What is said when this cannot be opened."""
    with pytest.raises(PortError) as caught:
        open_port(name, str(LINE))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_no_port(tmp_path: Path) -> None:
    """A missing device, a plain file and a directory are refused."""
    (tmp_path / "file").touch()
    assert refused(str(tmp_path / "ttyX")).endswith(
        "no such port; check the name and the cable; modlens ports lists those that are here"
    )
    assert "not a serial port" in refused(str(tmp_path / "file"))
    assert refused(str(tmp_path)).startswith(str(tmp_path))


def test_an_unknown_scheme_is_wrong_use() -> None:
    """An unknown scheme is reported with the known ones."""
    with pytest.raises(UsageError, match=r"tcp://x: unknown port type; use /dev"):
        open_port("tcp://x", str(LINE))
    with pytest.raises(PortError):
        open_port("socket://", str(LINE))


def test_a_socket_is_a_port() -> None:
    """A device server: bytes are read, none are written, and its end is reported."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        name = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with PortReader(name, LINE) as hearing:
            peer, _ = server.accept()
            peer.sendall(DATA)
            assert hearing.read_up_to(len(DATA)) == DATA
            assert not select.select([peer], [], [], 0.05)[0]
            peer.close()
            assert "lost" in str(hearing.wait_until_lost())
    assert "refused" in refused(name)


def test_a_port_without_a_descriptor_is_read_by_a_thread(
    monkeypatch: pytest.MonkeyPatch, wire: tuple[int, str]
) -> None:
    """A port without file descriptor (RFC 2217, Windows): its end is reported, no thread stays."""
    monkeypatch.setattr(serial_module, "_descriptor", lambda port: None)
    monkeypatch.setattr(sys, "platform", "elsewhere")
    before = threading.active_count()
    with PortReader(wire[1], Line(19200, 8, "N")) as hearing:
        os.write(wire[0], DATA)
        assert hearing.read_up_to(len(DATA)) == DATA
    assert threading.active_count() == before


def test_what_does_not_fit_is_counted_and_marked() -> None:
    """The queue is bounded; after the loss the port's bytes go on, marked."""
    inbox = Inbox(300)
    for number in range(5):
        inbox.put(0, bytes([number]))
    first = inbox.take(0.0)
    inbox.put(0, b"x")
    (later,) = inbox.take(0.0)
    assert [one[2] for one in first] == [bytes([number]) for number in range(len(first))]
    assert len(first) + inbox.lost() == 5
    assert inbox.lost() > 0
    assert (later[2], later[4]) == (b"x", True)
