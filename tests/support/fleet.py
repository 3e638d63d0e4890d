"""A fleet's archive: a folder for each bus with a recording a shift, in four formats, some damaged.

Buses poll three units each. What they carry is a function of the bus and the shift alone, so that
a test can say what has to be in the rows.
"""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random

import _modlens
from tests.doctor.network import Network
from tests.doctor.recorded import EPOCH_S
from tests.support.logs import LogEntry, write

__all__ = ["DAMAGED", "FORMATS", "Traffic", "archive"]

FORMATS = ("chunks", "socat", "raw", "pcap")
DAMAGED = ("cut.jsonl.gz", "empty.log", "notes.txt")
"""Names of files that cannot be read, or not to their end."""

_EPOCH_NS = 1_795_132_800_000_000_000
"""2026-11-20T00:00:00Z; `date -ud 2026-11-20 +%s`."""

_SHIFT_NS = 8 * 3600 * 1_000_000_000
_UNITS = (1, 2, 3)
_SILENT = 17
"""Every so many requests one gets no answer."""


@dataclass(frozen=True, slots=True)
class Traffic:
    """The exchanges of a bus in a shift of eight hours, as recordings of several formats."""

    bus: int
    shift: int
    requests: int

    def exchanges(self) -> Iterator[tuple[int, bytes, bytes | None]]:
        """Time of the request in ns, the ADUs."""
        rng = Random(self.bus * 1000 + self.shift)
        now = _EPOCH_NS + self.shift * _SHIFT_NS
        for number in range(self.requests):
            unit, address = _UNITS[number % len(_UNITS)], 100 + number % 5
            now += rng.randrange(80, 120) * 1_000_000
            answer = bytes([unit, 3, 4, *rng.randbytes(4)])
            silent = number % _SILENT == _SILENT - 1
            yield (
                now,
                _framed(bytes([unit, 3, 0, address, 0, 2])),
                None if silent else _framed(answer),
            )

    def reads(self) -> Iterator[tuple[int, bytes]]:
        """What a tap reads: time in ns (whole milliseconds) and bytes, a frame each."""
        for now, request, answer in self.exchanges():
            yield now, request
            if answer is not None:
                yield now + 21_000_000, answer

    def chunks(self) -> bytes:
        """As a chunk log; times are whole milliseconds."""
        rows = (f'{{"t": {now / 1e9:.3f}, "hex": "{data.hex()}"}}\n' for now, data in self.reads())
        return "".join(rows).encode()

    def socat(self) -> bytes:
        """As a log of socat -x."""
        entries = [
            LogEntry(now, sent=len(data) == 8 and data[1] == 3, data=data)
            for now, data in self.reads()
        ]
        return write("socat", entries).encode()

    def raw(self) -> bytes:
        """As the bytes of the line."""
        return b"".join(data for _, data in self.reads())

    def pcap(self) -> bytes:
        """As a capture of a TCP connection."""
        network = Network()
        flow = network.flow("10.0.0.1", f"10.0.{self.bus}.2")
        flow.open(self.shift * _SHIFT_NS / 1e9 - 36 * 3600)  # the network's clock begins at noon
        for number, (now, request, answer) in enumerate(self.exchanges()):
            at = now / 1e9 - EPOCH_S
            flow.send(at, True, _mbap(number, request))
            if answer is not None:
                flow.send(at + 0.02, False, _mbap(number, answer))
        return network.pcap()

    def recording(self, form: str) -> bytes:
        """As a recording of one of `FORMATS`."""
        data: bytes = getattr(self, form)()
        return data


def archive(folder: Path, *, buses: int = 20, shifts: int = 10, requests: int = 40) -> list[Path]:
    """Write the archive; gives its files, the damaged ones of the first bus among them."""
    endings = {"chunks": "jsonl", "socat": "log", "raw": "bin", "pcap": "pcap"}
    paths = []
    for bus in range(buses):
        place = folder / f"bus-{bus:02d}"
        place.mkdir(parents=True)
        form = FORMATS[bus % len(FORMATS)]
        for shift in range(shifts):
            paths.append(place / f"shift-{shift:03d}.{endings[form]}")
            paths[-1].write_bytes(Traffic(bus, shift, requests).recording(form))
    log = gzip.compress(Traffic(0, shifts, requests * 20).chunks(), mtime=0)
    for name, data in zip(
        DAMAGED,
        (
            log[: len(log) // 2],
            b"",
            b"The pump was changed on Monday; see the file of the plant.\n" * 9,
        ),
        strict=True,
    ):
        paths.append(folder / "bus-00" / name)
        paths[-1].write_bytes(data)
    return sorted(paths)


def _framed(adu: bytes) -> bytes:
    return adu + _modlens.crc16(adu).to_bytes(2, "little")


def _mbap(number: int, frame: bytes) -> bytes:
    adu = frame[:-2]
    return number.to_bytes(2, "big") + b"\0\0" + len(adu).to_bytes(2, "big") + adu
