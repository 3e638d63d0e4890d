"""The types of ports that can be tapped, and how their names look."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SCHEMES", "Scheme"]


@dataclass(frozen=True, slots=True)
class Scheme:
    """A type of port: an example of its name, what it is, whether it takes line settings."""

    name: str
    example: str
    title: str
    takes_line_settings: bool = True


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
    )
}
"""The part of a port's name before `://` -> its type."""
