"""What several threads gain: whole exports by one thread and by several, in turn.

    python -m bench.threads                     # 512 MB of bus bytes as raw RTU and in a capture
    python -m bench.threads --megabytes 64 --runs 3
    python -m bench.threads line.bin plant.pcap

`make bench-threads`. A line for each recording and format: the medians of the wall time of one
thread and of several, their ratio, and beside it what the machine gives at best: how much more is
done in the same time when as many processes of one thread export the recording side by side, which
share caches and memory, but wait for nobody. Then the CPU seconds of both, the peak memory of both,
and whether the bytes are equal (status 1 if not). Seconds of wall mean something only on a machine
that does nothing else: the load average follows each line.
"""

from __future__ import annotations

import argparse
import filecmp
import os
import statistics
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.support.processes import side_by_side, timed
from bench.support.workload import Workload

MEGABYTE = 1 << 20
COLUMNS = (
    "time,mbap_id,unit,function,address,quantity,data,exception,request_frame,response_time_us"
)


def recordings(folder: Path, megabytes: int, *, log: bool) -> Iterator[Path]:
    """Recordings of the workload, one at a time: they are large."""
    workload = Workload()
    writers = {"line.bin": workload.write_raw, "line.pcap": workload.write_capture}
    if log:
        writers["line.log"] = workload.write_log
    for name, write in writers.items():
        path = write(folder / name, megabytes)
        yield path
        path.unlink()


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def compare(path: Path, suffix: str, folder: Path, options: argparse.Namespace) -> bool:
    """Print the line of a recording; whether the bytes are equal."""

    def export(threads: int, out: str) -> list[str]:
        words = [sys.executable, "-m", "analyzer", "export", str(path), "--columns", COLUMNS]
        return [*words, "-o", str(folder / f"{out}{suffix}"), "--threads", str(threads)]

    costs: dict[int, list[tuple[float, float, float]]] = {1: [], options.threads: []}
    walls_of_processes = []
    beside = [f"beside{number}" for number in range(options.threads)]
    for _ in range(options.runs):
        for threads, measured in costs.items():
            measured.append(timed(export(threads, str(threads))))
        walls_of_processes.append(side_by_side([export(1, name) for name in beside]))
    for name in beside:
        (folder / f"{name}{suffix}").unlink()
    one, other = (folder / f"{threads}{suffix}" for threads in costs)
    is_equal = filecmp.cmp(one, other, shallow=False)
    one.unlink()
    other.unlink()
    (wall, cpu, _), (wall_of_all, cpu_of_all, _) = (
        tuple(map(statistics.median, zip(*measured, strict=True))) for measured in costs.values()
    )
    peak, peak_of_all = (max(it[2] for it in measured) for measured in costs.values())
    best = options.threads * wall / statistics.median(walls_of_processes)
    say(
        f"{path.name:12} {suffix:8} {wall:8.2f} {wall_of_all:8.2f} s {wall / wall_of_all:5.2f}x"
        f" of {best:4.2f}x"
        f"  CPU {cpu:6.2f} {cpu_of_all:6.2f} s  peak {peak:4.0f} {peak_of_all:4.0f} MiB"
        f"  {'equal' if is_equal else 'DIFFERENT'}  load {os.getloadavg()[0]:.1f}"
    )
    return is_equal


def main() -> int:
    """Run all; the status is 1 where bytes differ."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", type=Path, help="recordings in place of those made")
    parser.add_argument("--megabytes", type=int, default=512, help="of bus bytes (512)")
    parser.add_argument("--runs", type=int, default=5, help="of each, in turn (5)")
    parser.add_argument("--threads", type=int, default=2, help="beside one (2)")
    parser.add_argument("--log", action="store_true", help="a log with times, too")
    parser.add_argument("--to", nargs="+", default=["csv"], help="formats (csv)")
    parser.add_argument("--folder", type=Path, help="where recordings and exports are written")
    options = parser.parse_args()
    if options.threads < 2:  # noqa: PLR2004 - two differ from one
        parser.error("--threads: two or more")
    say(f"{'':21} {'one':>8} {options.threads:>8} threads")
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        made = recordings(folder, options.megabytes, log=options.log)
        equal = [
            compare(path, f".{form}", folder, options)
            for path in options.files or made
            for form in options.to
        ]
    return 0 if all(equal) else 1


if __name__ == "__main__":
    sys.exit(main())
