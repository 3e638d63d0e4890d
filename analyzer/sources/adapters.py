"""The serial adapters of this machine, and what is known of each.

pyserial finds them; the kernel tells the latency timer; what chips do with bytes is common
knowledge, a row each.

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

from analyzer.sources.driver import latency_timer

__all__ = ["Adapter", "Chip", "adapters", "chip_of"]

_BY_ID = Path("/dev/serial/by-id")
_SLOW_MS = 2


@dataclass(frozen=True, slots=True)
class Chip:
    """A family of adapters: its name, and what it does with bytes and their times."""

    name: str
    behaviour: str


_CHIPS: Mapping[int, Chip] = MappingProxyType(
    {
        0x0403: Chip("FTDI", "62 bytes a packet; a line error marks all of it"),
        0x1A86: Chip("CH340", "32 bytes a packet: long answers come in pieces"),
        0x10C4: Chip("CP210x", "packets of 64 bytes"),
        0x067B: Chip("PL2303", "packets of 64 bytes"),
        0x04D8: Chip("Microchip", "packets of 64 bytes"),
        0x2341: Chip("Arduino", "a USB serial port of its firmware"),
        0x0483: Chip("STM32", "a USB serial port of its firmware"),
        0x2E8A: Chip("RP2040", "a USB serial port of its firmware"),
    }
)
"""USB vendor -> chip."""


@dataclass(frozen=True, slots=True)
class Adapter:
    """A port, its chip (None where it has none that is known), and what limits its times.

    `stable_name` is a name that stays when adapters are plugged in another order; `is_accessible`
    whether it may be opened.
    """

    port: str
    title: str
    chip: Chip | None
    stable_name: str | None
    timer_ms: int | None
    is_accessible: bool

    @property
    def limit(self) -> str:
        """What limits the resolution of times, and how to mend it, in words."""
        if self.timer_ms is not None and self.timer_ms >= _SLOW_MS:
            return f"latency timer {self.timer_ms} ms: the tap sets it to 1 ms where it may"
        if self.timer_ms is not None:
            return f"latency timer {self.timer_ms} ms"
        if not sys.platform.startswith("linux"):
            return "this system does not tell: pauses of less than some ms may be hidden"
        return "no latency timer; bytes come as the driver hands them on"


def chip_of(vendor: int | None) -> Chip | None:
    """The chip of a USB vendor's number."""
    return None if vendor is None else _CHIPS.get(vendor)


def adapters() -> list[Adapter]:
    """All serial ports, by name; ports of the mainboard that lack hardware are not there."""
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
