"""A serial port that only listens.

There is no way to write here, on purpose: a tap that can transmit will one day do so into a running
plant. DTR and RTS are set inactive before the port is opened, because many adapters enable their
driver by one of them. (What stays outside of our hands: Linux itself raises both for some
microseconds while it opens a port, and RFC 2217 talks to its device server, not to the bus.)

Each read keeps the time at which it returned: on POSIX the descriptor is read directly, as soon as
`select` says that there is something, because a buffer in between would join what the line had
apart.

>>> import tempfile
>>> with Port(tempfile.mktemp(prefix="tty"), Line(19200)) as port:
...     port.read(0.1)
Traceback (most recent call last):
...
dissectors.errors.PortError: ...: no such port; check the name and the cable
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import select
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

from analyzer.line import Line
from analyzer.sources import SCHEMES
from dissectors.errors import PortError, UsageError

__all__ = ["Chunk", "Clock", "Port", "devices"]

READ_SIZE = 4096

_ADVICE = {
    errno.ENOENT: "no such port; check the name and the cable",
    errno.EACCES: "no permission to open it; on Linux join its group (often dialout), log in again",
    errno.EPERM: "no permission to open the port",
    errno.EBUSY: "the port is in use by another program; close it first",
    errno.EAGAIN: "the port is in use by another program; close it first",
    errno.ENOTTY: "not a serial port; recordings are read by `modlens decode`",
    errno.EISDIR: "a directory, not a serial port",
    errno.ECONNREFUSED: "the connection was refused; check address and port number",
    errno.EIO: "the port was lost; was the adapter unplugged?",
}


_NUMBER = re.compile(r"(?:\[Errno |\()(\d+)[\],]")


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes of one read, and when it returned (ns since 1970), never before the stop bit."""

    data: bytes
    time_ns: int


class Clock:
    """UTC that never runs back.

    The monotonic clock, set by the wall clock again only when they differ by a second.

    So a correction of the wall clock does not bend response times, while suspending the machine or
    setting its clock still shows (as a jump forward).

    >>> clock = Clock()
    >>> clock.now_ns() <= clock.now_ns()
    True
    """

    _JUMP_NS = 1_000_000_000

    def __init__(self) -> None:
        self._shift = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Nanoseconds since 1970 UTC."""
        monotonic = time.monotonic_ns()
        shift = time.time_ns() - monotonic
        if shift - self._shift > self._JUMP_NS:
            self._shift = shift
        return monotonic + self._shift


class Port:
    """An open port, read only and exclusively.

    A device, `socket://host:port` or `rfc2217://host:port`.

    `name` is the port as given, `line` its settings. `PortError` says what is wrong with the port,
    `UsageError` that its name is of no known kind. Use it in `with`.
    """

    def __init__(self, name: str, line: Line, clock: Clock | None = None) -> None:
        self.name = name
        self._clock = clock or Clock()
        scheme = name.partition("://")[0] if "://" in name else ""
        if scheme not in SCHEMES:
            known = ", ".join(kind.example for kind in SCHEMES.values())
            raise UsageError(f"{name}: no port of a known kind; there are {known}")
        try:
            self._port = _open(name, line, local=not scheme)
        except (OSError, ValueError, _settings_error()) as error:
            raise PortError(_advice(error, line), port=name) from error
        self._fd = _descriptor(self._port)

    def read(self, timeout: float) -> Chunk | None:
        """What has come in, waiting at most `timeout` seconds; None when nothing came.

        `PortError` if the port is lost.
        """
        try:
            data = self._read_buffered(timeout) if self._fd is None else self._read_fd(timeout)
        except (OSError, ValueError, _settings_error()) as error:
            raise PortError(_advice(error, None), port=self.name) from error
        now = self._clock.now_ns()
        if data is None:
            raise PortError(_ADVICE[errno.EIO], port=self.name)
        return Chunk(data, now) if data else None

    def close(self) -> None:
        """Close the port; a port that is already gone is closed, too."""
        with contextlib.suppress(OSError):
            self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _read_fd(self, timeout: float) -> bytes | None:
        assert self._fd is not None
        ready, _, _ = select.select([self._fd], [], [], timeout)
        if not ready:
            return b""
        try:
            return os.read(self._fd, READ_SIZE) or None  # ready, but empty: the other end is gone
        except BlockingIOError:  # somebody else took it
            return b""

    def _read_buffered(self, timeout: float) -> bytes:
        self._port.timeout = timeout
        first: bytes = self._port.read(1)
        rest: bytes = self._port.read(self._port.in_waiting) if first else b""
        return first + rest


def _open(name: str, line: Line, *, local: bool) -> Any:
    """The port, open; pyserial is imported here, because most uses of the package have no port."""
    import serial  # noqa: PLC0415

    port = serial.serial_for_url(name, do_not_open=True)
    port.timeout = 0
    port.dtr = False
    port.rts = False
    if local:
        port.exclusive = True
    port.baudrate = line.baud
    if not _is_pseudo_terminal(name):  # those have no characters, and Linux refuses parity on them
        port.bytesize = line.data_bits
        port.parity = line.parity
        port.stopbits = line.stop_bits
    port.open()
    return port


def _is_pseudo_terminal(name: str) -> bool:
    return os.path.realpath(name).startswith("/dev/pts/")


def _descriptor(port: Any) -> int | None:
    """The descriptor to select on.

    None where there is none (RFC 2217) or select takes only sockets (Windows).
    """
    if os.name != "posix":
        return None
    try:
        return int(port.fileno())
    except (AttributeError, OSError):  # io.UnsupportedOperation is an OSError
        return None


def _settings_error() -> type[Exception]:
    """What POSIX raises for settings that a port does not take; it is no OSError."""
    try:
        import termios  # noqa: PLC0415
    except ImportError:
        return OSError
    return termios.error


def _advice(error: Exception, line: Line | None) -> str:
    number = getattr(error, "errno", None)
    if number is None and error.args and isinstance(error.args[0], int):
        number = error.args[0]
    if number == errno.EINVAL and line is not None:
        return f"the port does not take the settings {line}"
    if number in _ADVICE:
        return _ADVICE[number]
    text = str(error)
    found = _NUMBER.search(text)  # pyserial puts the system's number into the text only
    if found and int(found[1]) in _ADVICE:
        return _ADVICE[int(found[1])]
    if "disconnected" in text:
        return _ADVICE[errno.EIO]
    return f"the port cannot be used: {text}"


def devices() -> list[str]:
    """The names of the serial ports that the system knows."""
    from serial.tools.list_ports import comports  # noqa: PLC0415

    return sorted(one.device for one in comports())
