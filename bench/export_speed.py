"""What exports cost, compared with tshark on the same traffic: CPU seconds of whole processes.

`make bench-exports`, or `python -m bench.export_speed [MEGABYTES]`. Of a few runs the cheapest one
counts, because whatever else goes on in the machine only adds. Each output has a line with three
rates: of the writer alone, through Rust and without a file (the example `speed`, where cargo is);
of the whole process; and of that without what a program takes to begin, which is its run on one
frame. So the second and third have reading, framing, pairing and writing the file in them.

tshark reads the pcapng that modlens wrote of the recording, modlens reads the raw bytes, and finds
and pairs the frames itself; or both read one file of Modbus/TCP.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import _modlens
from bench.support.workload import BLOCK, PEER_BYTES, traffic

ROOT = Path(__file__).parent.parent

FIELDS = (
    "frame.time_epoch", "mbtcp.unit_id", "modbus.func_code", "modbus.exception_code",
    "modbus.request_frame", "modbus.response_time", "modbus.regnum16", "modbus.regval_uint16",
)  # fmt: skip
COLUMNS = "time,unit,function,exception,request_frame,response_time_us,address,data"
EIGHT = ("--columns", COLUMNS)
TEN = (
    "--columns",
    "time,bus,unit,function,exception,status,address,quantity,data,response_time_us",
)
FRAMES = ("--table", "frames")

EXPORTS = {
    "csv, eight columns": ("csv", *EIGHT),
    "csv": ("csv",),
    "jsonl": ("jsonl",),
    "frames as jsonl": ("jsonl", *FRAMES),
    "pcapng": ("pcapng",),
    "parquet, ten columns": ("parquet", *TEN),
    "parquet": ("parquet",),
    "arrow": ("arrow",),
    "zeek": ("zeek",),
}
"""The exports that are timed: format, and further options."""

FIRST_PACKET = 1_700_000_000_000_000_000
TURN = 5_000_000
"""Time of the first packet in ns since 1970, and ns from packet to packet."""

PEERS = (
    ("-T fields, eight", ("-T", "fields", *(f"-e{field}" for field in FIELDS)), "csv", EIGHT),
    ("-T json", ("-T", "json"), "jsonl", FRAMES),
)
"""What tshark does, and what of ours is compared with it: a line a frame for both kinds of JSON."""


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU seconds and peak MiB of a process."""

    cpu: float
    peak: float


@dataclass(frozen=True, slots=True)
class Bench:
    """Runs programs: the folder for their files, and how often each is run."""

    folder: Path
    runs: int

    def cost(self, *words: str | Path, out: Path | None = None) -> Cost:
        """The cheapest of several runs of a program, whose output is discarded.

        `out` is taken away before each: to free the pages of an old file is no work of the new one.
        """
        quiet = subprocess.DEVNULL
        # Python may write its bytecode, as in any installation; otherwise half of a short run is
        # its compiler.
        environment = {**os.environ}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        found = []
        for _ in range(self.runs):
            if out is not None:
                out.unlink(missing_ok=True)
            process = subprocess.Popen(
                [str(word) for word in words], stdout=quiet, stderr=quiet, env=environment
            )
            _, status, usage = os.wait4(process.pid, 0)
            if status:
                raise SystemExit(f"{' '.join(map(str, words))} failed: {status}")
            found.append(Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024))
        return min(found, key=lambda cost: cost.cpu)

    def export(self, recording: Path, suffix: str, *words: str) -> tuple[Cost, Path]:
        """Run modlens on a recording; gives the file as well."""
        mode = () if recording.suffix != ".bin" else ("--mode", "rtu")
        out = self.folder / f"{recording.stem}.{suffix}"
        run = (sys.executable, "-m", "analyzer", "export", recording, *mode, "-o", out)
        return self.cost(*run, *words, out=out), out


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("megabytes", type=int, nargs="?", default=16, help="how much RTU to read")
    parser.add_argument("--runs", type=int, default=3, help="runs of each program; the best counts")
    parser.add_argument(
        "--no-peer", action="store_true", help="without tshark, which takes minutes"
    )
    options = parser.parse_args()
    pairs = traffic(PEER_BYTES)
    block = b"".join(request + response for request, response in pairs)
    count = options.megabytes * BLOCK // len(block)
    frames = 2 * len(pairs) * count
    sys.stdout.write(f"{frames // 2:,} transactions, {len(block) * count / 1e6:.1f} MB of RTU\n")
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(Path(name), options.runs)
        large, one = bench.folder / "large.bin", bench.folder / "one.bin"
        large.write_bytes(block * count)
        one.write_bytes(block[:8])
        started = bench.export(one, "csv")[0].cpu
        sys.stdout.write(f"modlens begins in {started:.2f} s\n")
        every_export(bench, large, frames, started)
        if not options.no_peer:
            capture, beginning = bench.export(large, "pcapng")[1], bench.export(one, "pcapng")[1]
            against(bench, (large, one), (capture, beginning), frames, PEERS)
            tcp, first = bench.folder / "large.pcap", bench.folder / "one.pcap"
            on_a_network(tcp, pairs * count)
            on_a_network(first, pairs[:1])
            against(bench, (tcp, first), (tcp, first), frames, PEERS[:1])


def on_a_network(path: Path, pairs: list[tuple[bytes, bytes]]) -> None:
    """The exchanges as Modbus/TCP, every packet at a time of its own, as on any network."""
    core = _modlens.Session(_modlens.Functions())
    bus = core.add_bus("bus", source="bus", mode="rtu", clock="utc")
    capture, now = _modlens.Capture("tcp", classic=True), FIRST_PACKET
    with path.open("wb") as file:
        for at, pair in enumerate(pairs):
            for frame in pair:
                now += TURN
                core.feed(bus, frame, now)
            if at % 1000 == 0:
                capture.put(core.take())
                file.writelines(iter(capture.more, b""))
        core.flush()
        capture.put(core.take())
        file.write(capture.end())


def alone(recording: Path) -> dict[str, str]:
    """Million rows per second of each writer alone; empty where there is no cargo."""
    cargo = shutil.which("cargo")
    if cargo is None:
        return {}
    words = ("run", "--release", "--quiet", "-p", "modlens-writers", "--example", "speed", "--")
    run = subprocess.run(
        [cargo, *words, recording], capture_output=True, text=True, check=True, cwd=ROOT
    )
    found = re.finditer(r"^(.+?) +\d+ ns a row, +([\d.]+) M rows/s", run.stdout, re.MULTILINE)
    return {line[1]: line[2] for line in found}


def every_export(bench: Bench, large: Path, frames: int, started: float) -> None:
    """A line for each kind of output."""
    writers = alone(large)
    sys.stdout.write(
        f"{'million rows/s':<22} {'rows':<12} writer alone  whole process  without start\n"
    )
    for title, (suffix, *words) in EXPORTS.items():
        found, _ = bench.export(large, suffix, *words)
        kind = "frames" if suffix == "pcapng" or "frames" in words else "transactions"
        rows = frames if kind == "frames" else frames // 2
        whole, rest = (rows / cpu / 1e6 for cpu in (found.cpu, found.cpu - started))
        sys.stdout.write(
            f"{title:<22} {kind:<12} {writers.get(title, '-'):>12} {whole:>14.2f} {rest:>14.2f}"
            f"  {found.cpu:5.2f} s, peak {found.peak:.0f} MiB\n"
        )


def against(
    bench: Bench,
    ours: tuple[Path, Path],
    theirs: tuple[Path, Path],
    frames: int,
    peers: tuple[tuple[str, tuple[str, ...], str, tuple[str, ...]], ...],
) -> None:
    """Both programs on the same frames.

    `ours` and `theirs` are a file, and its first frame alone.
    """
    started = bench.export(ours[1], "csv")[0].cpu
    peer_started = bench.cost("tshark", "-r", theirs[1]).cpu
    for title, how, suffix, words in peers:
        peer = bench.cost("tshark", "-r", theirs[0], *how)
        found, _ = bench.export(ours[0], suffix, *words)
        sys.stdout.write(
            f"{ours[0].suffix} {suffix} {found.cpu:.2f} s; tshark {title} {peer.cpu:.2f} s for"
            f" {frames:,} frames of {theirs[0].suffix}, peak {peer.peak:.0f} MiB:"
            f" {peer.cpu / found.cpu:.0f} times as fast,"
            f" {(peer.cpu - peer_started) / (found.cpu - started):.0f} times without the start\n"
        )


if __name__ == "__main__":
    main()
