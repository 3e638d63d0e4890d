"""What the doctor costs beside statistics, in instructions: `python -m bench.doctor_cost`.

Each runs on 1 MiB of exchanges (or `--mebibytes`) and on a few, whose figure is taken off: start
and imports. Raw RTU, lines with times, and such lines with one frame in thirty damaged. Needs
valgrind, and a core that was built as it is released.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from random import Random

from bench.support.workload import traffic

START = 1 << 12
DAMAGED = 1 / 30
CHARACTER_S = 10 / 19200
ASKED = (
    "import sys, analyzer; getattr(analyzer.decode(sys.argv[2], line='19200-8N1'), sys.argv[1])()"
)


def recordings(size: int, folder: Path) -> list[Path]:
    """Raw bytes and lines with times of as much traffic, and lines with damage."""
    rng, at = Random(1), 1.7e9
    raw, lines, damaged = bytearray(), [], []
    for pair in traffic(size):
        for frame in pair:
            raw += frame
            at += 0.01 + CHARACTER_S * len(frame)
            hit = bytearray(frame)
            if rng.random() < DAMAGED:
                hit[rng.randrange(len(hit))] ^= 1 << rng.randrange(8)
            lines.append(f'{{"t": {at:.6f}, "hex": "{frame.hex()}"}}\n')
            damaged.append(f'{{"t": {at:.6f}, "hex": "{hit.hex()}"}}\n')
    paths = [folder / f"{size}.{name}" for name in ("bin", "jsonl", "damaged.jsonl")]
    paths[0].write_bytes(raw)
    paths[1].write_text("".join(lines), "utf-8")
    paths[2].write_text("".join(damaged), "utf-8")
    return paths


def instructions(what: str, path: Path) -> int:
    """Instructions of a process that reads the recording for statistics, or for the doctor."""
    tool = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    run = [*tool, sys.executable, "-c", ASKED, what, str(path)]
    said = subprocess.run(run, capture_output=True, text=True, check=True).stderr
    found = re.search(r"Collected : (\d+)", said)
    assert found is not None, said
    return int(found[1])


def main() -> None:
    """Print a line for each recording."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--mebibytes", type=int, default=1)
    size = parser.parse_args().mebibytes << 20
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        pairs = zip(recordings(size, folder), recordings(START, folder), strict=True)
        for whole, start in pairs:
            stats, doctor = (
                instructions(what, whole) - instructions(what, start)
                for what in ("stats", "doctor")
            )
            name = whole.name.removeprefix(f"{size}.")
            sys.stdout.write(f"{name}: stats {stats:,}, doctor {doctor:,}: {doctor / stats:.2f}\n")


if __name__ == "__main__":
    main()
