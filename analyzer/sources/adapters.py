"""The serial adapters of this machine and their properties.

pyserial lists them, the kernel reports their latency timers; what each chip does with bytes is in
the table below.

>>> chip_of(0x0403).name
'FTDI'
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from _modlens import latency_timer

__all__ = ["Adapter", "Chip", "adapters", "chip_of"]

_BY_ID = Path("/dev/serial/by-id")
_SLOW_MS = 2


@dataclass(frozen=True, slots=True)
class Chip:
    """A family of USB adapters, and how it delivers bytes."""

    name: str
    behaviour: str


_CHIPS: Mapping[int, Chip] = MappingProxyType(
    {
        0x0403: Chip("FTDI", "packets of 62 bytes; a line error marks the whole packet"),
        0x1A86: Chip("CH340", "packets of 32 bytes: long responses arrive in blocks"),
        0x10C4: Chip("CP210x", "packets of 64 bytes"),
        0x067B: Chip("PL2303", "packets of 64 bytes"),
        0x04D8: Chip("Microchip", "packets of 64 bytes"),
        0x2341: Chip("Arduino", "a USB serial port implemented in firmware"),
        0x0483: Chip("STM32", "a USB serial port implemented in firmware"),
        0x2E8A: Chip("RP2040", "a USB serial port implemented in firmware"),
    }
)
"""USB vendor id -> chip."""


@dataclass(frozen=True, slots=True)
class Adapter:
    """A serial port of this machine.

    `chip` is None where it is not known. `stable_name` is a path that stays the same when adapters
    are plugged in in another order, None where there is none. `timer_ms` is the latency timer.
    `is_accessible` says whether this user may open the port.
    """

    port: str
    title: str
    chip: Chip | None
    stable_name: str | None
    timer_ms: int | None
    is_accessible: bool

    @property
    def limit(self) -> str:
        """What limits the resolution of times at this port, and what can be done, in words."""
        if self.timer_ms is not None and self.timer_ms >= _SLOW_MS:
            return f"latency timer {self.timer_ms} ms: the tap sets it to 1 ms if permitted"
        if self.timer_ms is not None:
            return f"latency timer {self.timer_ms} ms"
        if not sys.platform.startswith("linux"):
            return "this system does not report it: pauses of a few ms may be hidden"
        return "no adjustable latency timer; bytes arrive as the driver delivers them"


def chip_of(vendor: int | None) -> Chip | None:
    """The chip of a USB vendor id; None where it is not known."""
    return None if vendor is None else _CHIPS.get(vendor)


def adapters() -> list[Adapter]:
    """All serial ports by name, without ports of the mainboard that have no hardware."""
    from serial.tools import list_ports  # noqa: PLC0415

    found = []
    for port in sorted(list_ports.comports()):
        title = port.product or port.description
        found.append(
            Adapter(
                port.device,
                "" if title in (None, "n/a") else str(title),
                chip_of(port.vid),
                _stable_name(port.device),
                latency_timer(port.device),
                os.access(port.device, os.R_OK) or os.name == "nt",
            )
        )
    return found


def _stable_name(device: str) -> str | None:
    if not _BY_ID.is_dir():
        return None
    real = os.path.realpath(device)
    return next(
        (str(link) for link in sorted(_BY_ID.iterdir()) if str(link.resolve()) == real), None
    )
