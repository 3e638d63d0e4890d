"""Where bytes come from: ports, files, standard input.

Nothing here knows Modbus, and nothing here writes. `BINARY` and `all_formats` are the registry of
file formats, `schemes.SCHEMES` that of port types. Another text format: a row in dialects.toml.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import _modlens

__all__ = ["BINARY", "Format", "all_formats", "is_binary"]


@dataclass(frozen=True, slots=True)
class Format:
    """A file format of recordings.

    `binary` formats hold raw bytes as sent on the line, or a capture of `packets` or of a logic
    analyzer's `samples`; the others are text, which the core parses. `clock` says what kind of
    times the format has. `sample` is what its first lines look like, as shown by `modlens formats`.
    """

    name: str
    binary: bool
    title: str
    clock: str
    sample: tuple[str, ...]
    packets: bool = False
    samples: bool = False


def all_formats(dialects: _modlens.Dialects | None = None) -> dict[str, Format]:
    """All formats by name: the binary ones, then those of the table of text dialects."""
    table = dialects or _modlens.Dialects()
    rows = (
        Format(
            row["name"],
            binary=False,
            title=row["title"],
            clock=row["clock"],
            sample=tuple(row["sample"].splitlines()),
        )
        for row in json.loads(table.rows())
    )
    return {**BINARY, **{row.name: row for row in rows}}


BINARY = {
    kind.name: kind
    for kind in (
        Format(
            "raw",
            binary=True,
            title="raw bytes as sent on the line",
            clock="none",
            sample=("(bytes)",),
        ),
        Format(
            "pcap",
            binary=True,
            title="network and serial captures from tcpdump and others",
            clock="utc",
            sample=("(binary; Modbus on port 502, or the ports of --port)",),
            packets=True,
        ),
        Format(
            "pcapng",
            binary=True,
            title="network and serial captures from Wireshark and others",
            clock="utc",
            sample=("(binary; Modbus on port 502, or the ports of --port)",),
            packets=True,
        ),
        Format(
            "sigrok",
            binary=True,
            title="logic analyzer sessions of sigrok and PulseView (.sr)",
            clock="relative",
            sample=("(binary; lines, baud rate, parity and polarity are detected)",),
            samples=True,
        ),
        Format(
            "saleae-digital",
            binary=True,
            title="Saleae Logic: channel levels as CSV, one row per edge",
            clock="relative",
            sample=("Time [s],RX,TX", "0.000000000,1,1", "0.010000000,0,1", "0.010104167,1,1"),
            samples=True,
        ),
    )
}
"""Name -> format, of those that are not text. `all_formats` has the dialects, too."""


def is_binary(name: str) -> bool:
    """Whether a format is binary; dialects that users have added are text.

    >>> is_binary("raw"), is_binary("pymodbus+hex")
    (True, False)
    """
    return name in BINARY
