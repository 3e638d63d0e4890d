"""Whether memory grows with the recording: the peak of whole processes, by size of the recording.

`make bench-memory`, or `python -m bench.peak_memory [MEGABYTES ...]` (64, 512 and 2048 of bus bytes
if none are named; captures and logs only up to 512, since they are many times as large). One thread
and as many as there are cores. A line a path, a column a size; what is written goes nowhere.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench.support.processes import measured
from bench.support.workload import Workload

ROOT = Path(__file__).parent.parent
LARGEST_TEXT = 512
"""Megabytes of bus bytes up to which captures and logs are made: 1.8 GB of either."""

Recording = Callable[[Path, int], Path]


@dataclass(frozen=True)
class Job:
    """What is measured: name, file, and the words after `modlens`, `{}` being the file."""

    name: str
    suffix: str
    words: str

    def command(self, path: Path, threads: int) -> list[str]:
        """The words of the process."""
        words = self.words.format(path, threads=f"--threads {threads}")
        return [sys.executable, "-m", "analyzer", *words.split()]


JOBS = (
    Job("raw RTU to CSV", "bin", "export {} --from raw --mode rtu --to csv {threads}"),
    Job("raw RTU to Parquet", "bin", "export {} --from raw --mode rtu --to parquet {threads}"),
    Job("statistics of raw RTU", "bin", "stats {} --from raw --mode rtu"),
    Job("doctor of raw RTU", "bin", "doctor {} --from raw --mode rtu"),
    Job("Modbus/TCP pcap to CSV", "pcap", "export {} --to csv {threads}"),
    Job("Modbus/TCP pcap to JSON lines", "pcap", "export {} --to jsonl {threads}"),
    Job("log with times to CSV", "hex", "export {} --to csv {threads}"),
)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("megabytes", type=int, nargs="*", default=[64, 512, 2048])
    sizes = parser.parse_args().megabytes
    workload = Workload()
    make: dict[str, Recording] = {
        "bin": workload.write_raw,
        "pcap": workload.write_capture,
        "hex": workload.write_log,
    }
    rows = [(job, threads) for job in JOBS for threads in thread_counts(job)]
    peaks: dict[tuple[Job, int], list[str]] = {row: [] for row in rows}
    with tempfile.TemporaryDirectory() as folder:
        for size in sizes:
            for suffix, write in make.items():
                of_suffix = [row for row in rows if row[0].suffix == suffix]
                if suffix != "bin" and size > LARGEST_TEXT:
                    for row in of_suffix:
                        peaks[row].append("")
                    continue
                path = write(Path(folder) / f"all.{suffix}", size)
                for job, threads in of_suffix:
                    peaks[job, threads].append(peak(job.command(path, threads)))
                path.unlink()
    heads = ["peak MiB", "threads", *(f"{size} MB" for size in sizes)]
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    lines += [f"| {job.name} | {n} | {' | '.join(peaks[job, n])} |" for job, n in rows]
    sys.stdout.write("\n".join(lines) + "\n")
    own_peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sys.stdout.write(f"(no peak is below that of this script, {own_peak:.0f} MiB)\n")


def thread_counts(job: Job) -> list[int]:
    """The numbers of threads with which a job is run."""
    return [1, os.cpu_count() or 1] if "{threads}" in job.words else [1]


def peak(command: list[str]) -> str:
    """The peak of a process in MiB."""
    return f"{measured(command, {**os.environ, 'PYTHONPATH': str(ROOT)})[1]:.0f}"


if __name__ == "__main__":
    main()
