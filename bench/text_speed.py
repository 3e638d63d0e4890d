"""How fast logs are read, a line each dialect: MB of text a CPU second, and the memory it takes.

`make bench-text`, or `python -m bench.text_speed [MEGABYTES [DIALECT...]]`. Each dialect is written
by `tests/support/logs.py` from the traffic of `bench/support/workload.py`. `engine` stops at byte
strings with their times and sides, `transactions` is all that `decode` does but for output; both
are processes of the example `text` of the core. The last lines are those of the installed command,
and of a file four times as large.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from bench.support.processes import measured
from bench.support.workload import traffic
from tests.support.logs import NOON, SINGLE_LINE, WRITERS, LogEntry, write

ROOT = Path(__file__).resolve().parent.parent
CARGO = ("cargo", "build", "--release", "--locked", "--package", "modlens-writers")
UNIQUE = 1 << 19
"""Bytes of text that are made; they are repeated."""

NO_CHECKSUM = ("mbusd", "emodbus", "ascii-lines")
STEP_NS = 21_000_000
PLAIN = "hex"


def said(dialect: str) -> list[LogEntry]:
    """Exchanges, each 21 ms after the one before; in dialects without that of RTU without it."""
    end = -2 if dialect in NO_CHECKSUM else None
    records = []
    for number, (request, response) in enumerate(traffic(UNIQUE // 3)):
        records.append(LogEntry(NOON + number * STEP_NS, True, request[:end]))
        records.append(LogEntry(NOON + number * STEP_NS + 9_000_000, False, response[:end]))
    return records


def log(dialect: str, path: Path, size: int) -> None:
    """A file of at least this size."""
    text = write(dialect, said(dialect)).encode()
    with path.open("wb") as file:
        while file.tell() < size:
            file.write(text)


def main() -> None:
    """Prints the table."""
    out = sys.stdout
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("megabytes", type=int, nargs="?", default=24, help="how much to read")
    parser.add_argument("dialects", nargs="*", help="only these")
    options = parser.parse_args()
    megabytes = options.megabytes
    names = options.dialects or sorted(WRITERS, key=lambda name: (name not in SINGLE_LINE, name))
    subprocess.run([*CARGO, "--example", "text"], cwd=ROOT, check=True)
    program = ROOT / "target" / "release" / "examples" / "text"
    out.write(f"{'dialect':<24}{'engine':>8}{'transactions':>14}  MB/s of text\n")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bus.log"
        for name in names:
            log(name, path, megabytes << 20)
            rates = []
            for how in ("engine", "session"):
                cpu, _ = measured([str(program), how, name, str(path)])
                rates.append(path.stat().st_size / cpu / 1e6)
            lines = "" if name in SINGLE_LINE else "  (several lines a record)"
            out.write(f"{name:<24}{rates[0]:8.0f}{rates[1]:14.0f}{lines}\n")
            out.flush()
        for size in (megabytes, 4 * megabytes):
            log(PLAIN, path, size << 20)
            cpu, peak = measured([sys.executable, "-m", "analyzer", "stats", str(path)])
            rate = path.stat().st_size / cpu / 1e6
            out.write(f"{size} MiB of {PLAIN}: modlens stats: {rate:.0f} MB/s, {peak:.0f} MiB\n")


if __name__ == "__main__":
    main()
