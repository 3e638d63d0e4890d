"""How fast captures are decoded, beside `tcpdump 'tcp port 502'` and TShark, and in what memory.

`make bench`, or `python -m bench.capture_speed [MEGABYTES]`. Two captures are made: all of it
Modbus/TCP (one message a packet), and one hundredth of it, the rest being other traffic. CPU
seconds of whole processes on one core; peers that are not installed are left out.
"""

from __future__ import annotations

import argparse
import shutil
import struct
import sys
import tempfile
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

from bench.support.processes import measured
from bench.support.workload import traffic

MEGABYTE = 1 << 20
UNIQUE = 1 << 20
CLIENT, SERVER, OTHER = b"\x0a\x00\x00\x01", b"\x0a\x00\x00\x02", b"\x0a\x00\x00\x03"
CLIENT_PORT, MODBUS, HTTPS = 50000, 502, 443
SEGMENT = 1448
SHARE = 0.01


def packet(
    ends: tuple[bytes, bytes], ports: tuple[int, int], place: list[int], data: bytes
) -> bytes:
    """An Ethernet frame with a TCP segment; `place` holds sequence and acknowledgement number."""
    tcp = struct.pack(">HHIIBBHHH", *ports, *place, 0x50, 0x18, 0x2000, 0, 0)
    ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 40 + len(data), 1, 0, 64, 6, 0, *ends)
    return bytes(12) + b"\x08\x00" + ip + tcp + data


class Writer:
    """A pcap file whose clock ticks a millisecond a packet."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=MEGABYTE)
        self._file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262144, 1))
        self._count = 0
        self.size = 24

    def add(self, data: bytes) -> None:
        """One more packet."""
        seconds, rest = divmod(self._count, 1000)
        head = struct.pack("<IIII", 1_700_000_000 + seconds, rest * 1000, len(data), len(data))
        self._file.write(head + data)
        self._count += 1
        self.size += 16 + len(data)

    def close(self) -> None:
        """The file is whole."""
        self._file.close()


def modbus() -> Iterator[bytes]:
    """Requests and responses on one connection, for ever."""
    ask, answer = [1, 1], [1, 1]
    for number, (request, response) in enumerate(cycle(traffic(UNIQUE))):
        for adu, out, back, ends, ports in (
            (request, ask, answer, (CLIENT, SERVER), (CLIENT_PORT, MODBUS)),
            (response, answer, ask, (SERVER, CLIENT), (MODBUS, CLIENT_PORT)),
        ):
            body = adu[:-2]
            data = struct.pack(">HHH", number & 0xFFFF, 0, len(body)) + body
            yield packet(ends, ports, [out[0], back[0]], data)
            out[0] = (out[0] + len(data)) & 0xFFFFFFFF


def write(path: Path, size: int, share: float) -> None:
    """A capture of `size` bytes of which `share` is Modbus."""
    writer, packets, sequence, of_modbus = Writer(path), modbus(), 1, 0.0
    data = bytes(range(256)) * 6
    while writer.size < size:
        if of_modbus <= share * writer.size:
            before = writer.size
            writer.add(next(packets))
            of_modbus += writer.size - before
        else:
            writer.add(packet((OTHER, CLIENT), (HTTPS, 40000), [sequence, 1], data[:SEGMENT]))
            sequence = (sequence + SEGMENT) & 0xFFFFFFFF
    writer.close()


def main() -> None:
    """Prints the table."""
    out = sys.stdout
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("megabytes", type=int, nargs="?", default=128, help="how much to read")
    megabytes = parser.parse_args().megabytes
    modlens = [sys.executable, "-m", "analyzer"]
    with tempfile.TemporaryDirectory() as folder:
        for name, share in (("Modbus/TCP", 1.0), ("1 % Modbus/TCP", SHARE)):
            for size in (megabytes, 4 * megabytes):
                path = Path(folder) / "capture.pcap"
                write(path, size * MEGABYTE, share)
                jobs = [
                    ("modlens stats", [*modlens, "stats", str(path)]),
                    (
                        "modlens export to CSV",
                        [*modlens, "export", str(path), "-o", f"{folder}/t.csv"],
                    ),
                ]
                if size == megabytes:
                    jobs += [
                        (
                            "tcpdump 'tcp port 502'",
                            ["tcpdump", "-r", str(path), "-w", f"{folder}/f.pcap", "tcp port 502"],
                        ),
                        (
                            "tshark",
                            [
                                "tshark",
                                "-r",
                                str(path),
                                "-Y",
                                "mbtcp",
                                "-T",
                                "fields",
                                "-e",
                                "mbtcp.trans_id",
                            ],
                        ),
                    ]
                for title, command in jobs:
                    if command[0] == "tshark" and share == 1.0:
                        continue  # it needs more memory than the machine has
                    if shutil.which(command[0]) is None:
                        continue
                    cpu, peak = measured(command)
                    rate = path.stat().st_size / cpu / 1e6
                    figures = f"{cpu:.2f} CPU s, {rate:.0f} MB/s, {peak:.0f} MiB"
                    out.write(f"{size} MiB, {name}: {title}: {figures}\n")
                    out.flush()


if __name__ == "__main__":
    main()
