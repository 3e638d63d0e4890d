"""The operating system's serial driver: error marks, error counters, latency.

Linux only, in part other POSIX systems. What the system refuses is described in words
(`Driver.advice`) instead of raised. Nothing here sends, and nothing touches DTR or RTS. FTDI chips
hold bytes back until their latency timer expires, 16 ms by default; `ASYNC_LOW_LATENCY` makes the
kernel set it to 1 ms, and makes other drivers deliver bytes at once.

>>> Driver().advice
''
"""

from __future__ import annotations

import contextlib
import os
import struct
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

__all__ = ["COUNTERS", "Driver", "counters", "latency_timer", "mark_errors", "reduce_latency"]

COUNTERS = ("frame", "overrun", "parity", "brk", "buf_overrun")
"""The counters of the kernel's `serial_icounter_struct` that count damaged or lost bytes."""

_TIOCGICOUNT = 0x545D
_TIOCGSERIAL, _TIOCSSERIAL = 0x541E, 0x541F
_ASYNC_LOW_LATENCY = 0x2000
_ICOUNTER = struct.Struct("11i9i")  # cts dsr rng dcd rx tx frame overrun parity brk buf_overrun
_COUNTER_FIELDS = MappingProxyType(
    {"frame": 6, "overrun": 7, "parity": 8, "brk": 9, "buf_overrun": 10}
)
_SERIAL_SIZE = 128
_FLAGS_OFFSET = 16  # of serial_struct: type, line, port, irq are four ints before it
_MAX_TIMER_MS = 2


@dataclass(frozen=True, slots=True)
class Driver:
    """The state of a port's driver after it has been configured.

    `marks_errors` says whether line errors are marked among the bytes, `timer_ms` is the latency
    timer, `low_latency` the kernel's flag; None where the driver has no such thing. `advice` says
    what limits the resolution of times and what to do about it, and is empty where nothing does.
    """

    marks_errors: bool = False
    timer_ms: int | None = None
    low_latency: bool | None = None
    advice: str = ""


def reduce_latency(fd: int, name: str) -> Driver:
    """Ask the driver to deliver bytes at once; gives its state afterwards."""
    if not sys.platform.startswith("linux") or os.path.realpath(name).startswith("/dev/pts/"):
        return Driver()
    low = _low_latency(fd)
    timer = latency_timer(name)
    if timer is not None and timer >= _MAX_TIMER_MS:
        with contextlib.suppress(OSError):
            _timer_file(name).write_text("1\n", encoding="ascii")
        timer = latency_timer(name)
    return Driver(timer_ms=timer, low_latency=low, advice=_advice(name, timer))


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


def counters(fd: int) -> Mapping[str, int]:
    """The driver's error counters since the system started; empty where it has none."""
    if not sys.platform.startswith("linux"):
        return {}
    import fcntl  # noqa: PLC0415

    try:
        answer = fcntl.ioctl(fd, _TIOCGICOUNT, bytes(_ICOUNTER.size))
    except OSError:
        return {}
    counts = _ICOUNTER.unpack(answer)
    return {name: counts[place] for name, place in _COUNTER_FIELDS.items()}


def latency_timer(name: str) -> int | None:
    """Milliseconds for which the adapter may hold bytes back; None where it has no such timer."""
    try:
        return int(_timer_file(name).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _timer_file(name: str) -> Path:
    tty = os.path.basename(os.path.realpath(name))
    return Path("/sys/class/tty") / tty / "device" / "latency_timer"


def _low_latency(fd: int) -> bool | None:
    """Set `ASYNC_LOW_LATENCY`; whether it is set now, None where the driver does not know it."""
    import fcntl  # noqa: PLC0415

    try:
        settings = bytearray(fcntl.ioctl(fd, _TIOCGSERIAL, bytes(_SERIAL_SIZE)))
    except OSError:
        return None
    (flags,) = struct.unpack_from("i", settings, _FLAGS_OFFSET)
    if flags & _ASYNC_LOW_LATENCY:
        return True
    struct.pack_into("i", settings, _FLAGS_OFFSET, flags | _ASYNC_LOW_LATENCY)
    try:
        fcntl.ioctl(fd, _TIOCSSERIAL, bytes(settings))
    except OSError:
        return False
    return True


def _advice(name: str, timer: int | None) -> str:
    if timer is None or timer < _MAX_TIMER_MS:
        return ""
    return (
        f"the adapter holds bytes back for up to {timer} ms: pauses and response times below"
        f" {2 * timer} ms are unreliable; to fix this as root: echo 1 > {_timer_file(name)}"
    )
