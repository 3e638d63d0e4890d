"""A serial port that only listens.

There is deliberately no way to write: a tap that can transmit will one day do so into a running
plant. DTR and RTS are set inactive before the port is opened, because many adapters enable their
RS-485 driver by one of them. (Two things are beyond our control: Linux itself raises both for some
microseconds while it opens a port, and RFC 2217 talks to its device server, not to the bus.)

Each read keeps the time at which it returned. On POSIX the core reads the file descriptor itself,
in a thread outside of Python's lock, because a buffer in between would join separate reads.

>>> import tempfile
>>> Port(tempfile.mktemp(prefix="tty"), Line(19200))
Traceback (most recent call last):
...
dissectors.errors.PortError: ...: no such port; ...
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from _modlens import Inbox
from analyzer.line import Line
from analyzer.sources.driver import Driver, counters, mark_errors, reduce_latency
from analyzer.sources.schemes import SCHEMES
from dissectors.errors import PortError, UsageError

__all__ = ["Chunk", "Port", "devices", "lost_port_error"]

READ_TIMEOUT_S = 0.05
"""Seconds after which a reader thread checks whether it has been stopped."""

_PLACEHOLDER = Line(9600, 8, "N", 1)
"""Settings to open a port with that has none, or whose settings are not known yet."""

_ADVICE = {
    errno.ENOENT: "no such port; check the name and the cable; modlens ports lists those that are"
    " here",
    errno.EACCES: "no permission to open it; on Linux join its group (often dialout), log in again",
    errno.EPERM: "no permission to open the port",
    errno.EBUSY: "the port is in use by another program; close it first",
    errno.EAGAIN: "the port is in use by another program; close it first",
    errno.ENOTTY: "not a serial port; use `modlens decode` for recordings",
    errno.EISDIR: "a directory, not a serial port",
    errno.ECONNREFUSED: "the connection was refused; check address and port number",
    errno.EIO: "the port was lost; was the adapter unplugged?",
}


_ERRNO_IN_TEXT = re.compile(r"(?:\[Errno |\()(\d+)[\],]")


@dataclass(frozen=True, slots=True)
class Chunk:
    """The bytes of one read, and the time at which it returned (ns since 1970).

    That is never before the stop bit of the last byte. `errors` are the positions of bytes that the
    receiver has marked (parity, framing, break); `hole` says that bytes were lost before these, and
    `recorded` that the recorder has them.
    """

    data: bytes
    time_ns: int
    errors: Sequence[int] = ()
    hole: bool = False
    recorded: bool = False


class Port:
    """An open port, for reading only and used exclusively; use it in `with`.

    `name` is a device, `socket://host:port` or `rfc2217://host:port`; `line` are its settings, None
    where it has none or they are not known yet; `driver` is the state of the system's driver.
    `PortError` if the port cannot be opened, `UsageError` for a name of no known type.
    """

    def __init__(self, name: str, line: Line | None) -> None:
        self.name = name
        self.line = line
        scheme = name.partition("://")[0] if "://" in name else ""
        if scheme not in SCHEMES:
            known = ", ".join(kind.example for kind in SCHEMES.values())
            raise UsageError(f"{name}: unknown port type; use {known}")
        self.takes_line_settings = SCHEMES[scheme].takes_line_settings
        self._reader: _ReaderThread | None = None
        with self._as_port_error():
            self._port = _open(name, line or _PLACEHOLDER, local=not scheme)
        self._fd = _descriptor(self._port)
        local = self._fd is not None and not scheme
        self.driver = reduce_latency(self._fd, name) if local and self._fd is not None else Driver()
        self._is_local = local
        self._mark_errors()

    def listen(self, inbox: Inbox, number: int) -> None:
        """Start to read the port into `inbox`, under this number."""
        if self._fd is not None:
            inbox.listen(number, self._fd, marked=self.driver.marks_errors)
        else:
            self._reader = _ReaderThread(self._port, inbox, number)

    def set_line(self, line: Line) -> None:
        """Change the line settings while the port is read; `PortError` if it does not take them."""
        self.line = line
        with self._as_port_error():
            _apply_settings(self._port, line, self.name)
        self._mark_errors()

    def counters(self) -> Mapping[str, int]:
        """The driver's error counters (see `driver.COUNTERS`); empty where it has none."""
        return counters(self._fd) if self._fd is not None and self._is_local else {}

    def stop(self) -> None:
        """Stop the thread that reads a port without a descriptor; the inbox ends the others."""
        if self._reader is not None:
            self._reader.stop()

    def close(self) -> None:
        """Stop reading and close the port; no error if it has been unplugged."""
        self.stop()
        with contextlib.suppress(OSError):
            self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _mark_errors(self) -> None:
        """Switch the marking of line errors on.

        Pyserial switches it off with every other setting.
        """
        if self._is_local and self._fd is not None:
            self.driver = replace(self.driver, marks_errors=mark_errors(self._fd))

    @contextlib.contextmanager
    def _as_port_error(self) -> Iterator[None]:
        """Raise errors of the system and of pyserial as `PortError`."""
        try:
            yield
        except (OSError, ValueError, _settings_error()) as error:
            raise PortError(_advice(error, self.line), port=self.name) from error


class _ReaderThread:
    """A thread that reads ports without a file descriptor: RFC 2217, and ports on Windows."""

    def __init__(self, port: Any, inbox: Inbox, number: int) -> None:
        self._stopped = threading.Event()
        self._port, self._inbox, self._number = port, inbox, number
        port.timeout = READ_TIMEOUT_S
        self._thread = threading.Thread(target=self._read, name=f"port {number}", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._thread.join()

    def _read(self) -> None:
        try:
            while not self._stopped.is_set():
                data: bytes = self._port.read(1)
                data += self._port.read(self._port.in_waiting) if data else b""
                if data:
                    self._inbox.put(self._number, data)
        # pyserial raises `TypeError` if the port is closed while it is read.
        except (OSError, ValueError, TypeError):
            self._inbox.put(self._number, None)


def lost_port_error(name: str, number: int) -> PortError:
    """The error for a port that was lost with this `errno` (0 where it is not known)."""
    return PortError(_advice(OSError(number or errno.EIO, ""), None), port=name)


def _open(name: str, line: Line, *, local: bool) -> Any:
    """Open a port; pyserial is imported here because most uses of the package have no port."""
    import serial  # noqa: PLC0415

    port = serial.serial_for_url(name, do_not_open=True)
    port.timeout = 0
    port.dtr = False
    port.rts = False
    if local:
        port.exclusive = True
    _apply_settings(port, line, name)
    port.open()
    return port


def _apply_settings(port: Any, line: Line, name: str) -> None:
    port.baudrate = line.baud
    # Pseudo terminals have no character format, and Linux refuses parity on them.
    if not _is_pseudo_terminal(name):
        port.bytesize = line.data_bits
        port.parity = line.parity
        port.stopbits = line.stop_bits


def _is_pseudo_terminal(name: str) -> bool:
    return os.path.realpath(name).startswith("/dev/pts/")


def _descriptor(port: Any) -> int | None:
    """The file descriptor to wait for.

    None where there is none (RFC 2217), or where only sockets can be waited for (Windows).
    """
    if os.name != "posix":
        return None
    try:
        return int(port.fileno())
    except (AttributeError, OSError):  # io.UnsupportedOperation is an OSError
        return None


def _settings_error() -> type[Exception]:
    """The exception that POSIX raises for settings that a port does not take.

    It is not an `OSError`.
    """
    try:
        import termios  # noqa: PLC0415
    except ImportError:
        return OSError
    return termios.error


def _advice(error: Exception, line: Line | None) -> str:
    """The text of an error of the system or pyserial, with what to do about it."""
    number = getattr(error, "errno", None)
    if number is None and error.args and isinstance(error.args[0], int):
        number = error.args[0]
    if number == errno.EINVAL and line is not None:
        return f"the port does not take the settings {line}"
    if number in _ADVICE:
        return _ADVICE[number]
    text = str(error)
    # pyserial has the system's error number in the message only.
    found = _ERRNO_IN_TEXT.search(text)
    if found and int(found[1]) in _ADVICE:
        return _ADVICE[int(found[1])]
    if "disconnected" in text:
        return _ADVICE[errno.EIO]
    return f"the port cannot be used: {text}"


def devices() -> list[str]:
    """The names of the serial ports that the system knows."""
    from serial.tools.list_ports import comports  # noqa: PLC0415

    return sorted(one.device for one in comports())
