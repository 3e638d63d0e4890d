"""Serial ports and device servers that are only listened to.

There is deliberately no way to write: a tap that can transmit will one day do so into a running
plant. On Linux the core opens serial ports of this machine (`_modlens.Tty`), with the smallest
window in which anything can reach the line. Elsewhere, and for device servers, pyserial does: DTR
and RTS are set inactive before the port is opened, because many adapters enable their RS-485 driver
by one of them. RFC 2217 talks to its device server, not to the bus.

Each read keeps the time at which it returned. On POSIX the core reads the file descriptor itself,
in a thread outside of Python's lock, because a buffer in between would join separate reads.

>>> import tempfile
>>> open_port(tempfile.mktemp(prefix="tty"), "19200-8E1")
Traceback (most recent call last):
...
modlens.PortError: ...: no such port; ...
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import sys
import threading
from collections.abc import Iterator, Mapping
from typing import Any

from _modlens import Inbox, Tty, port_advice
from analyzer.line import Line, parse_line
from analyzer.sources.schemes import LivePort, scheme_of
from dissectors.errors import PortError

__all__ = ["devices", "open_port"]

READ_TIMEOUT_S = 0.05
"""Seconds after which a reader thread checks whether it has been stopped."""

_PLACEHOLDER = Line(9600, 8, "N", 1)
"""Settings to open a port with that has none, or whose settings are not known yet."""

_ERRNO_IN_TEXT = re.compile(r"(?:\[Errno |\()(\d+)[\],]")


def open_port(name: str, settings: str | None) -> LivePort:
    """Open a device, `socket://host:port` or `rfc2217://host:port`, for this program alone.

    `PortError` if that is not possible.
    """
    if sys.platform == "linux" and not scheme_of(name).name:
        try:
            return Tty(name, settings)
        except OSError as error:
            raise PortError(str(error), port=name) from error
    return _PyserialPort(name, settings)


class _PyserialPort:
    """A port that pyserial opens; a `schemes.LivePort`."""

    advice = ""

    def __init__(self, name: str, settings: str | None) -> None:
        self._name, self._settings = name, settings
        scheme = scheme_of(name)
        self.takes_line_settings = scheme.takes_line_settings
        self.marks_errors = False
        self._reader: _ReaderThread | None = None
        self._is_local = not scheme.name
        with self._as_port_error():
            self._port = _open(name, self._line(), local=self._is_local)
        self._fd = _descriptor(self._port)
        self._mark_errors()

    def listen(self, inbox: Inbox, number: int) -> None:
        """Start to read the port into the inbox, under this number."""
        if self._fd is not None:
            inbox.listen(number, self._fd, marked=self.marks_errors)
        else:
            self._reader = _ReaderThread(self._port, inbox, number)

    def set_line(self, line: str) -> None:
        """Change the line settings while the port is read; `PortError` if it does not take them."""
        self._settings = line
        with self._as_port_error():
            _apply_settings(self._port, self._line())
        self._mark_errors()

    def counters(self) -> Mapping[str, int]:
        """No error counters: pyserial has none."""
        return {}

    def stop(self) -> None:
        """Stop the thread that reads a port without a descriptor; the inbox ends the others."""
        if self._reader is not None:
            self._reader.stop()

    def close(self) -> None:
        """Stop reading and close the port; no error if it has been lost."""
        self.stop()
        with contextlib.suppress(OSError):
            self._port.close()

    def _line(self) -> Line:
        return _PLACEHOLDER if self._settings is None else parse_line(self._settings)

    def _mark_errors(self) -> None:
        """Switch the marking of line errors on: pyserial switches it off with other settings."""
        if self._is_local and self._fd is not None:
            self.marks_errors = mark_errors(self._fd)

    @contextlib.contextmanager
    def _as_port_error(self) -> Iterator[None]:
        """Raise errors of the system and of pyserial as `PortError`."""
        try:
            yield
        except (OSError, ValueError, _settings_error()) as error:
            raise PortError(_advice(error, self._settings), port=self._name) from error


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


def _open(name: str, line: Line, *, local: bool) -> Any:
    """Open a port; pyserial is imported here because most uses of the package have no port."""
    import serial  # noqa: PLC0415

    if scheme_of(name).name == "rfc2217":
        from analyzer.sources.rfc2217 import BoundedSerial  # noqa: PLC0415

        port: Any = BoundedSerial(None)
        port.port = name
    else:
        port = serial.serial_for_url(name, do_not_open=True)
    port.timeout = 0
    port.dtr = False
    port.rts = False
    if local:
        port.exclusive = True
    _apply_settings(port, line)
    port.open()
    return port


def _apply_settings(port: Any, line: Line) -> None:
    port.baudrate = line.baud
    port.bytesize = line.data_bits
    port.parity = line.parity
    port.stopbits = line.stop_bits


def mark_errors(fd: int) -> bool:
    """Have the driver mark bytes with line errors (INPCK, PARMRK); whether it does."""
    try:
        import termios  # noqa: PLC0415
    except ImportError:
        return False
    try:
        mode = termios.tcgetattr(fd)
        mode[0] &= ~(termios.IGNPAR | termios.IGNBRK | termios.BRKINT | termios.ISTRIP)
        mode[0] |= termios.INPCK | termios.PARMRK
        termios.tcsetattr(fd, termios.TCSANOW, mode)
        return bool(termios.tcgetattr(fd)[0] & termios.PARMRK)
    except termios.error:
        return False


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


def _advice(error: Exception, settings: str | None) -> str:
    """The text of an error of the system or pyserial, with what to do about it."""
    text = str(error)
    number = getattr(error, "errno", None)
    if number is None and error.args and isinstance(error.args[0], int):
        number = error.args[0]
    # pyserial has the system's error number in the message only.
    in_text = _ERRNO_IN_TEXT.search(text)
    numbers = [number, int(in_text[1]) if in_text else None]
    if "disconnected" in text:
        numbers.append(errno.EIO)
    for one in numbers:
        advice = None if one is None else port_advice(one, settings)
        if advice is not None:
            return advice
    return f"the port cannot be used: {text}"


def devices() -> list[str]:
    """The names of the serial ports that the system knows."""
    from serial.tools.list_ports import comports  # noqa: PLC0415

    return sorted(one.device for one in comports())
