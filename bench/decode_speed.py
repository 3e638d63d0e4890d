"""How fast `modlens export` turns raw RTU bytes into CSV, and its memory, beside pymodbus.

`make bench`, or `python bench/decode_speed.py [MEGABYTES]`. CPU seconds of whole processes on one
core; pymodbus gets the bounds and directions of all frames for free, does no pairing and writes
nothing.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import _modlens

BLOCK = 1 << 20
PEER_BYTES = 1 << 20
UNITS = tuple(range(1, 11))


def frame(unit: int, pdu: bytes) -> bytes:
    """An RTU frame."""
    body = bytes([unit]) + pdu
    return body + _modlens.crc16(body).to_bytes(2, "little")


def exchange(rng: random.Random) -> tuple[bytes, bytes]:
    """A request and its response: mostly reads, some bits and writes, 1 % exceptions."""
    unit, address = rng.choice(UNITS), rng.randrange(0x1000)
    code = rng.choices((3, 4, 1, 2, 6, 16), (56, 14, 10, 10, 5, 5))[0]
    if code in (3, 4):
        quantity = rng.choice((1, 2, 2, 4, 10, 20, 60, 125))
        ask = bytes([code]) + address.to_bytes(2) + quantity.to_bytes(2)
        answer = bytes([code, 2 * quantity]) + rng.randbytes(2 * quantity)
    elif code in (1, 2):
        quantity = rng.choice((8, 16, 100))
        ask = bytes([code]) + address.to_bytes(2) + quantity.to_bytes(2)
        answer = bytes([code, (quantity + 7) // 8]) + bytes((quantity + 7) // 8)
    elif code == 6:  # noqa: PLR2004 - the function code
        ask = answer = bytes([code]) + address.to_bytes(2) + rng.randbytes(2)
    else:
        data = rng.randbytes(20)
        answer = bytes([code]) + address.to_bytes(2) + (10).to_bytes(2)
        ask = answer + bytes([20]) + data
    if rng.random() < 0.01:  # noqa: PLR2004 - one in a hundred
        answer = bytes([code | 0x80, 2])
    return frame(unit, ask), frame(unit, answer)


def traffic(size: int) -> list[tuple[bytes, bytes]]:
    """Exchanges of about this many bytes; the same on every machine."""
    rng = random.Random(1)
    pairs = []
    while size > 0:
        pairs.append(exchange(rng))
        size -= sum(map(len, pairs[-1]))
    return pairs


def measured(command: list[str]) -> tuple[float, float]:
    """CPU seconds and peak MiB of a child process."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, stdout=quiet, stderr=quiet)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} failed: {status}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def pymodbus_rate(pairs: list[tuple[bytes, bytes]]) -> float:
    """Bytes a CPU second of pymodbus's decoders, framed and told who speaks."""
    from pymodbus.framer import FramerRTU  # noqa: PLC0415 - a peer, only here
    from pymodbus.pdu import DecodePDU  # noqa: PLC0415

    sides = (FramerRTU(DecodePDU(True)), FramerRTU(DecodePDU(False)))
    start = time.process_time()
    size = 0
    for pair in pairs:
        for framer, data in zip(sides, pair, strict=True):
            framer.handleFrame(data, 0, 0)
            size += len(data)
    return size / (time.process_time() - start)


def main() -> None:
    """Prints the table."""
    out = sys.stdout
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("megabytes", type=int, nargs="?", default=64, help="how much to read")
    megabytes = parser.parse_args().megabytes
    pairs = traffic(PEER_BYTES)
    block = b"".join(request + response for request, response in pairs)
    with tempfile.TemporaryDirectory() as folder:
        for size in (megabytes, 4 * megabytes):
            recording, table = Path(folder) / "bus.bin", Path(folder) / "bus.csv"
            with recording.open("wb") as file:
                while file.tell() < size * BLOCK:
                    file.write(block)
            command = [sys.executable, "-m", "analyzer", "export", str(recording), "--mode", "rtu"]
            cpu, peak = measured([*command, "-o", str(table)])
            rate = size * BLOCK / cpu
            speed = f"{cpu:.2f} CPU s, {rate / 1e6:.0f} MB/s"
            out.write(f"{size} MiB of RTU to CSV: {speed}, peak {peak:.0f} MiB\n")
            table.unlink()
    peer = pymodbus_rate(pairs)
    out.write(f"pymodbus, decoding alone: {peer / 1e6:.2f} MB/s\n")
    out.write(f"modlens to CSV is {rate / peer:.0f} times as fast\n")
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    out.write(f"(this script itself: {own:.0f} MiB)\n")


if __name__ == "__main__":
    main()
