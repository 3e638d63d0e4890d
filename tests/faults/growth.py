"""What every command that reads recordings takes, as they grow: memory and processor time.

    python -m tests.faults.growth --mb 1 4 16

Each runs on the same traffic at three sizes: ten units, reads and writes, refusals and silence, as
a log with times and as a capture. The bar: 256 MiB at the largest, and time that grows in
proportion, which is judged by the last step against the one before it: start-up is in neither.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.support.workload import Workload
from tests.faults.measured import Measured, measured

__all__ = ["COMMANDS", "OTHERS", "Growth", "grown", "write_files"]

MB = 1 << 20
MAX_MIB = 256
MAX_RATIO = 1.7
"""So many times the time that proportion asks for, and a little for what a busy machine adds."""

SLACK_S = 0.3
BLOCK = 32 * 1024
TABLE_ROW = 256
"""A map has 65,536 registers at 16 MB: more there are not."""

COMMANDS: dict[str, list[str]] = {
    "decode": ["decode", "{log}"],
    "decode a capture": ["decode", "{capture}"],
    **{
        f"export to {form}": ["export", "{log}", "--to", form]
        for form in ("csv", "jsonl", "md", "pcapng", "influx")
    },
    **{
        f"export to {form}": ["export", "{log}", "-o", f"{{out}}/rows.{form}"]
        for form in ("parquet", "zeek", "sqlite", "arrow")
    },
    "export as tcp": ["export", "{log}", "--to", "pcapng", "--style", "tcp"],
    "export readings": ["export", "{log}", "--to", "csv", "--table", "readings"],
    "show": ["show", "{log}", "--txn", "100"],
    "show a register": ["show", "{log}", "--at", "1:hr:4171", "--as", "all"],
    "doctor": ["doctor", "{log}"],
    "doctor on a capture": ["doctor", "{capture}"],
    "stats": ["stats", "{log}"],
    "security": ["security", "{capture}"],
    "baseline": ["baseline", "{log}", "-o", "{out}/usual.toml"],
    "diff": ["diff", "{log}", "{log}"],
    "join": ["join", "{capture}", "{log}", "-o", "{out}/joined.csv"],
    "report": ["report", "{log}", "-o", "{out}/report.html"],
    "plot": ["plot", "{log}", "unit == 1 and address == 4171"],
    "map": ["map", "{log}"],
    "learn": ["learn", "{log}", "--unit", "1"],
    "match": ["match", "{log}"],
    "find": ["find", "{log}", "--value", "231.4", "--at", "2", "--within", "5s"],
    "import": ["import", "csv", "{table}", "-o", "{out}/map.toml"],
    "profiles": ["profiles", "check", "{profile}"],
}
"""By a name of its own: the words, with places for the files."""

OTHERS = {
    "tap": "live: its memory over ten minutes is what `make soak` and `make memory` show",
    "mcp": "its tools are the commands above",
    "extcap": "live, as the tap is",
    **dict.fromkeys(
        ("page", "ports", "explain", "craft", "formats", "dashboards", "wireshark-setup"),
        "reads no recording",
    ),
}
"""Commands that are not measured, and why."""


@dataclass(frozen=True)
class Growth:
    """One command at all sizes."""

    name: str
    runs: list[Measured]

    @property
    def wrong(self) -> str | None:
        """What does not hold; None if all does."""
        statuses = [run.status for run in self.runs]
        if any(status not in {0, 1} for status in statuses):
            return f"exit statuses {statuses}: {self.runs[-1].err[-500:]}"
        if self.runs[-1].peak_mib > MAX_MIB:
            return f"{self.runs[-1].peak_mib:.0f} MiB"
        *_, first, second, third = (run.cpu_s for run in self.runs)
        if third - second > 4 * MAX_RATIO * max(second - first, 0.0) + SLACK_S:
            return f"{third:.1f} s after {second:.1f} and {first:.1f}"
        return None


def write_files(folder: Path, size: int) -> dict[str, str]:
    """The files of about this size, and a folder for what is written."""
    workload = Workload(BLOCK)
    made = {}
    for name, suffix, write in (
        ("log", "log", workload.write_log), ("capture", "pcap", workload.write_capture),
    ):  # fmt: skip
        path = folder / f"{size}.{suffix}"
        one = write(path, 1).stat().st_size
        made[name] = str(write(path, max(1, size // one)))
    out = folder / f"out-{size}"
    out.mkdir()
    table, profile = folder / f"{size}.csv", folder / f"{size}.toml"
    registers = range(min(size // TABLE_ROW, 65_536))
    rows = (f"register {number},{number},u16,V\n" for number in registers)
    table.write_text("name,address,type,unit\n" + "".join(rows))
    points = (
        f"[[registers]]\nat = 'hr:{number}'\nname = 'register {number}'\ntype = 'u16'\n"
        for number in registers
    )
    profile.write_text("profile = 1\n[device]\n" + "".join(points))
    return {**made, "table": str(table), "profile": str(profile), "out": str(out)}


def grown(name: str, files: Sequence[dict[str, str]]) -> Growth:
    """Run one command at each size, the smallest first."""
    words = COMMANDS[name]
    return Growth(name, [measured(*(word.format(**those) for word in words)) for those in files])


def _all(sizes: Sequence[float], names: Sequence[str]) -> Iterator[Growth]:
    with tempfile.TemporaryDirectory() as folder:
        files = [write_files(Path(folder), int(size * MB)) for size in sizes]
        for name in names:
            yield grown(name, files)


def main() -> int:
    """Run all, a line each; gives the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--mb", type=float, nargs=3, default=[1.0, 4.0, 16.0])
    parser.add_argument("--only", action="append", choices=list(COMMANDS))
    options = parser.parse_args()
    fell = 0
    for one in _all(options.mb, options.only or list(COMMANDS)):
        times = " ".join(f"{run.cpu_s:7.2f}" for run in one.runs)
        peaks = " ".join(f"{run.peak_mib:4.0f}" for run in one.runs)
        sys.stdout.write(f"{one.name:22} {times} s  {peaks} MiB  {one.wrong or ''}\n")
        sys.stdout.flush()
        fell += one.wrong is not None
    return 1 if fell else 0


if __name__ == "__main__":
    sys.exit(main())
