"""The types of ports that can be tapped, how their names look, and who opens them.

A new live source is a row in `SCHEMES` and a module with `open_port(name, settings)`, which returns
a `LivePort`. The loop that uses it is `_modlens.LiveRun`: it opens the port, calls `listen`, and
opens it again where it was lost. A port that has a descriptor passes it to `Inbox.listen`, and the
core reads it outside of Python's lock. Any other port reads in a thread of its own and passes each
read to `Inbox.put(number, data)`, and None at its end. It never sends to the line.

>>> scheme_of("socket://192.168.1.50:4001").title
'serial device server, raw TCP'
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from _modlens import Inbox
from dissectors.errors import UsageError

__all__ = ["SCHEMES", "LivePort", "Scheme", "open_port", "scheme_of"]


class LivePort(Protocol):
    """An open port, for reading only.

    `marks_errors` says whether the driver marks bytes with line errors among the others (PARMRK),
    `advice` what limits the resolution of its times, and what to do about it. Errors of its methods
    are `PortError` or `OSError`, and their text is shown to the user.
    """

    @property
    def takes_line_settings(self) -> bool:
        """Whether the port has line settings: raw TCP has none."""

    @property
    def marks_errors(self) -> bool:
        """Whether bytes with line errors are marked."""

    @property
    def advice(self) -> str:
        """What limits the port; empty where nothing does."""

    def listen(self, inbox: Inbox, number: int) -> None:
        """Start to read the port into the inbox, under this number."""

    def set_line(self, line: str) -> None:
        """Change the line settings (`19200-8E1`) while the port is read."""

    def counters(self) -> Mapping[str, int]:
        """The driver's error counters, by name; empty where it has none."""

    def stop(self) -> None:
        """Stop the thread that reads the port, if it has one."""

    def close(self) -> None:
        """Stop reading and close the port; no error if it has been lost."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """A type of port: an example of its name, what it is, whether it takes line settings.

    `module` has the `open_port` of its ports. It is imported when the first of them is opened.
    """

    name: str
    example: str
    title: str
    takes_line_settings: bool = True
    module: str = "analyzer.sources.serial"


SCHEMES = {
    scheme.name: scheme
    for scheme in (
        Scheme("", "/dev/ttyUSB0", "a serial port of this machine (COM3 on Windows)"),
        Scheme("socket", "socket://192.168.1.50:4001", "serial device server, raw TCP", False),
        Scheme(
            "rfc2217",
            "rfc2217://192.168.1.50:4001",
            "a serial device server that accepts line settings",
        ),
        Scheme(
            "esphome",
            "esphome://192.168.1.50/NAME",
            "a serial_proxy of ESPHome",
            module="analyzer.sources.esphome",
        ),
        Scheme(
            "udp",
            "udp://0.0.0.0:4001",
            "datagrams that a serial device server sends here",
            takes_line_settings=False,
            module="analyzer.sources.udp",
        ),
        Scheme(
            "wb-mge",
            "wb-mge://192.168.1.50/1",
            "the sniffer of a WB-MGE v3 gateway",
            takes_line_settings=False,
            module="analyzer.sources.wb_mge",
        ),
        Scheme(
            "modlens",
            "modlens://192.168.1.50:4010",
            "what another modlens tap serves",
            takes_line_settings=False,
            module="analyzer.sources.remote",
        ),
    )
}
"""The part of a port's name before `://` -> its type."""


def scheme_of(name: str) -> Scheme:
    """The type of a port; `UsageError` for a name of no known type."""
    scheme = SCHEMES.get(name.partition("://")[0] if "://" in name else "")
    if scheme is None:
        known = ", ".join(kind.example for kind in SCHEMES.values())
        raise UsageError(f"{name}: unknown port type; use {known}")
    return scheme


def open_port(name: str, settings: str | None) -> LivePort:
    """Open a port of any type, with these line settings; None where they are not known yet.

    `PortError` if that is not possible, `UsageError` for a name of no known type.
    """
    module = importlib.import_module(scheme_of(name).module)
    port: LivePort = module.open_port(name, settings)
    return port
