"""Where bytes come from: ports, files, standard input.

Nothing here knows Modbus, and nothing here writes.

`FORMATS` is the registry of what files can hold, `SCHEMES` that of what can be tapped. A further
format is a reader in the core and a row here.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FORMATS", "SCHEMES", "Format", "Scheme"]


@dataclass(frozen=True, slots=True)
class Format:
    """A form of recording.

    `binary` files are bytes of the line as they are, or a capture that holds `packets` or
    `samples`; others are text that the core reads.

    `sample` is what the first lines look like, as `modlens formats` shows them.
    """

    name: str
    binary: bool
    title: str
    clock: str
    sample: tuple[str, ...]
    packets: bool = False
    samples: bool = False


@dataclass(frozen=True, slots=True)
class Scheme:
    """A kind of port: how its name is written, what it is, whether it takes line settings."""

    name: str
    example: str
    title: str
    tunable: bool = True


FORMATS = {
    kind.name: kind
    for kind in (
        Format(
            "raw",
            binary=True,
            title="the bytes of the line as they are",
            clock="none",
            sample=("(bytes)",),
        ),
        Format(
            "hex",
            binary=False,
            title="hex text, plain or separated; times, Tx, Rx in front",
            clock="as printed",
            sample=("01 03 00 6B 00 03 74 17", "12:00:01.250 Rx: 0x01,0x03,0x06,..."),
        ),
        Format(
            "hexdump",
            binary=False,
            title="hexdump -C",
            clock="none",
            sample=(
                "00000000  01 03 00 6b 00 03 74 17  01 03 06 02 2b 00 00 00  |...k..t.....+...|",
            ),
        ),
        Format(
            "xxd",
            binary=False,
            title="xxd",
            clock="none",
            sample=("00000000: 0103 006b 0003 7417 0103 0602 2b00 0000  ...k..t.....+...",),
        ),
        Format(
            "chunks",
            binary=False,
            title="the chunk log: a read a line, with its time",
            clock="utc or relative",
            sample=('{"t": 1697041234.123456, "hex": "0103006b00037417"}',),
        ),
        Format(
            "pcap",
            binary=True,
            title="network and serial captures of tcpdump and others",
            clock="utc",
            sample=("(binary; Modbus on port 502, or as --port says)",),
            packets=True,
        ),
        Format(
            "pcapng",
            binary=True,
            title="network and serial captures of Wireshark and others",
            clock="utc",
            sample=("(binary; Modbus on port 502, or as --port says)",),
            packets=True,
        ),
        Format(
            "sigrok",
            binary=True,
            title="logic analyser sessions of sigrok and PulseView (.sr)",
            clock="relative",
            sample=("(binary; lines, baud rate, parity and polarity are found)",),
            samples=True,
        ),
    )
}
"""Name -> what files can hold."""

SCHEMES = {
    scheme.name: scheme
    for scheme in (
        Scheme("", "/dev/ttyUSB0", "a serial port of this machine (COM3 on Windows)"),
        Scheme("socket", "socket://192.168.1.50:4001", "raw TCP of a serial device server", False),
        Scheme(
            "rfc2217", "rfc2217://192.168.1.50:4001", "a device server that takes line settings"
        ),
    )
}
"""What stands before `://` -> what can be tapped."""
