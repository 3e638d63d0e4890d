"""What exports cost, beside tshark on the same traffic: CPU seconds of whole processes, one core.

`make bench-exports`, or `python -m bench.export_speed [MEGABYTES]`. tshark reads the pcapng that
modlens wrote; modlens reads the same frames as raw bytes, and finds and pairs them itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from bench.decode_speed import BLOCK, PEER_BYTES, traffic

FIELDS = (
    "frame.time_epoch", "mbtcp.unit_id", "modbus.func_code", "modbus.exception_code",
    "modbus.request_frame", "modbus.response_time", "modbus.regnum16", "modbus.regval_uint16",
)  # fmt: skip
COLUMNS = "time,unit,function,exception,request_frame,response_time_us,address,data"

EXPORTS = {
    "csv, eight columns": ("csv", "--columns", COLUMNS),
    "csv": ("csv",),
    "jsonl": ("jsonl",),
    "frames as jsonl": ("jsonl", "--table", "frames"),
    "pcapng": ("pcapng",),
    "parquet": ("parquet",),
    "arrow": ("arrow",),
    "zeek": ("zeek",),
}
"""What is written, and how: format, further options."""

PEERS = (
    ("-T fields, eight", ("-T", "fields"), "csv", ("--columns", COLUMNS)),
    ("-T json", ("-T", "json"), "jsonl", ("--table", "frames")),
)
"""What tshark does, and what of ours is compared with it: a line a frame for both kinds of JSON."""


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU seconds and peak MiB of a process."""

    cpu: float
    peak: float


def cost(*words: str | Path) -> Cost:
    """Run a program to its end; what it prints goes nowhere."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([str(word) for word in words], stdout=quiet, stderr=quiet)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(map(str, words))} failed: {status}")
    return Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


def export(recording: Path, out: Path, *words: str) -> Cost:
    """Run modlens on a file of raw RTU bytes."""
    run = (sys.executable, "-m", "analyzer", "export", recording, "--mode", "rtu")
    return cost(*run, "-o", out, *words)


def main() -> None:
    """Prints the table."""
    out = sys.stdout
    megabytes = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    pairs = traffic(PEER_BYTES)
    block = b"".join(request + response for request, response in pairs)
    count = megabytes * BLOCK // len(block)
    transactions = len(pairs) * count
    out.write(f"{transactions:,} transactions, {len(block) * count / 1e6:.1f} MB of RTU\n")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        large, small = folder / "large.bin", folder / "small.bin"
        large.write_bytes(block * count)
        small.write_bytes(block)
        for title, (suffix, *words) in EXPORTS.items():
            found = export(large, folder / f"large.{suffix}", *words)
            rate = transactions / found.cpu / 1e6
            out.write(
                f"{title:<18} {found.cpu:6.2f} s {rate:6.2f} M transactions/s"
                f" {2 * rate:6.2f} M frames/s {found.peak:5.0f} MiB\n"
            )
        compare(folder, small, 2 * len(pairs))


def compare(folder: Path, small: Path, frames: int) -> None:
    """Both programs on the same small traffic, less what each takes to begin."""
    out = sys.stdout
    capture, empty = folder / "small.pcapng", folder / "empty.bin"
    export(small, capture)
    empty.write_bytes(small.read_bytes()[:8])
    started = export(empty, folder / "empty.csv").cpu
    capture_of_one = folder / "empty.pcapng"
    export(empty, capture_of_one)
    tshark_started = cost("tshark", "-r", capture_of_one).cpu
    chosen = [word for field in FIELDS for word in ("-e", field)]
    for title, how, suffix, words in PEERS:
        more = chosen if "fields" in how else []
        peer = cost("tshark", "-r", capture, *how, *more)
        ours = export(small, folder / f"small.{suffix}", *words)
        out.write(
            f"tshark {title}: {peer.cpu:.2f} s for {frames:,} frames, {peer.peak:.0f} MiB;"
            f" modlens {suffix}: {ours.cpu:.2f} s, {peer.cpu / ours.cpu:.0f} times as fast,"
            f" {(peer.cpu - tshark_started) / (ours.cpu - started):.0f} times without the start\n"
        )


if __name__ == "__main__":
    main()
