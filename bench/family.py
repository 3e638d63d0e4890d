"""What decoding costs on every kind of ordinary traffic, and the median and the worst of them.

`make bench-family`, or `python -m bench.family [--megabytes N] [--only KIND]`. The kinds are the
rows of a table in the simulator (`modlens-bench family`): each differs in one thing from polls of
registers, or is a mixture in another form. None repeats its bytes. What modlens exports is compared
with what was generated, in the same run. Each program runs in turn, several times; the median of
the CPU seconds counts, less the start of the program. Costs are ns a frame.

- `--yardstick FOLDER` (`YARDSTICK=FOLDER make bench-family`): also `limit.rs` in there, a program
  that does nothing but what has to be done; the other columns are ratios to it. It reads no ASCII
  and no logs.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from bench.compare import (
    ARROW,
    COLUMNS,
    FIELDS,
    ROOT,
    Program,
    compiled,
    export,
    installed,
    source,
)
from bench.support.workload import Truth, read_truth

MAX_OPEN_SHARE = 0.002
"""The most requests of which it may be open whether they were answered: equal frames."""
BENCH = ROOT / "target" / "release" / "modlens-bench"
PYTHON = [sys.executable, "-c"]
STARTS = {
    "modlens": [*PYTHON, "import modlens, analyzer.api, analyzer.cli.outputs"],
    "pyarrow": [*PYTHON, "import modlens, analyzer.api, pyarrow"],
}
LIMITS = {".bin": ("valss", "bincsv"), ".pcap": ("tcpvals", "tcpcsv")}


@dataclass
class Row:
    """A kind of traffic: its programs by the name of the column, and the truth about it."""

    name: str
    truth: Truth
    programs: dict[str, Program]


def main() -> None:
    """Prints the table, a kind a line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--megabytes", type=int, default=16, help="of RTU bytes of each kind")
    parser.add_argument("--runs", type=int, default=5, help="runs of each; their median counts")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", metavar="KIND", help="one kind")
    parser.add_argument("--yardstick", metavar="FOLDER", help="a folder with limit.rs")
    options = parser.parse_args()
    build = ["cargo", "build", "--release", "--locked", "--quiet", "--package", "modlens-bench"]
    subprocess.run(build, check=True, cwd=ROOT)
    kinds = subprocess.run([BENCH, "family"], check=True, capture_output=True, text=True).stdout
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        limit = compiled(Path(options.yardstick), folder) if options.yardstick else None
        starts = {start: Program(start, words, 0) for start, words in STARTS.items()}
        rows = []
        for kind in kinds.split():
            if options.only in (None, kind.partition(".")[0]):
                rows.append(measured(kind, options, folder, limit, starts))
        sys.stdout.write("\n".join(table(rows, starts)) + "\n")


def measured(
    kind: str,
    options: argparse.Namespace,
    folder: Path,
    limit: Path | None,
    starts: dict[str, Program],
) -> Row:
    """Writes the traffic of a kind, checks what is exported of it, and times all programs."""
    name = kind.partition(".")[0]
    path, scratch = folder / kind, folder / "out"
    scratch.mkdir(exist_ok=True)
    words = [str(BENCH), "family", "--only", name, "--out", str(path)]
    words += ["--bytes", str(options.megabytes << 20), "--first-seed", str(options.seed - 1)]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    truth = Truth(**json.loads(done.stdout))
    check(name, path, scratch, truth)
    row = Row(name, truth, programs(path, scratch, truth.frames, limit))
    for _ in range(options.runs):
        for program in [*starts.values(), *row.programs.values()]:
            program.run(scratch)
    path.unlink()
    return row


def check(name: str, path: Path, scratch: Path, truth: Truth) -> None:
    """Ends with an error where an export differs from what was generated."""
    out = scratch / "check.csv"
    run = [*export(path, out), "--columns", "status,function,data"]
    subprocess.run(run, check=True, cwd=ROOT)
    with out.open(newline="") as file:
        found = read_truth(csv.DictReader(file))
    requests = truth.ok + truth.exception + truth.no_response
    differs = abs(found.ok - truth.ok) + abs(found.exception - truth.exception)
    if differs:
        sys.stderr.write(f"{name}: {differs} of {requests} requests differ\n")
    if differs > MAX_OPEN_SHARE * requests:
        raise SystemExit(f"{name}: exported were {found}, but generated were {truth}")


def programs(path: Path, scratch: Path, frames: int, limit: Path | None) -> dict[str, Program]:
    """What is timed on a recording, by the name of its column."""
    own, ten = [sys.executable, "-m", "analyzer"], ["--columns", COLUMNS]
    found = {
        "stats": Program("stats", [*own, "stats", *source(path)], frames, "modlens"),
        "CSV": Program("CSV", [*export(path, scratch / "a.csv"), *ten], frames, "modlens"),
    }
    if path.suffix == ".bin" and installed("pyarrow"):
        arrow = [*PYTHON, ARROW, str(path), COLUMNS]
        found["Arrow"] = Program("Arrow", arrow, frames, "pyarrow")
    if limit and path.suffix in LIMITS:
        columns, text = LIMITS[path.suffix]
        words = {"limit, columns": [columns, "0"], "limit, CSV": [f"{text}:{scratch / 'a.csv'}"]}
        for name, rest in words.items():
            if columns != "tcpvals" or name == "limit, CSV":
                found[name] = Program(name, [str(limit), str(path), *rest], frames)
    if path.suffix == ".pcap" and shutil.which("tshark"):
        words_of_tshark = ["tshark", "-n", "-r", str(path), "-T", "fields"]
        words_of_tshark += [f"-e{one}" for one in FIELDS]
        found["tshark"] = Program("tshark", words_of_tshark, frames)
    return found


def table(rows: list[Row], starts: dict[str, Program]) -> list[str]:
    """The lines of the table, in Markdown, with the median and the worst of each column."""
    start = {name: statistics.median(one.cpu) for name, one in starts.items()}
    costs: list[dict[str, float]] = []
    for row in rows:
        cost = {
            name: (statistics.median(one.cpu) - start.get(one.start, 0.0)) / one.frames * 1e9
            for name, one in row.programs.items()
        }
        for own, limit in (
            ("stats", "limit, columns"), ("Arrow", "limit, columns"), ("CSV", "limit, CSV"),
        ):  # fmt: skip
            if own in cost and limit in cost:
                cost[f"{own} / limit"] = cost[own] / cost[limit]
        if "tshark" in cost:
            cost["tshark / CSV"] = cost["tshark"] / cost["CSV"]
        costs.append(cost)
    heads = list(dict.fromkeys(name for cost in costs for name in cost))
    lines = [f"| ns a frame | frames | {' | '.join(heads)} |", f"|---|{'---|' * (len(heads) + 1)}"]

    def line(name: str, frames: str, cells: dict[str, float]) -> str:
        texts = [f"{cells[head]:.3g}" if head in cells else "" for head in heads]
        return f"| {name} | {frames} | {' | '.join(texts)} |"

    for row, cost in zip(rows, costs, strict=True):
        lines.append(line(row.name, f"{row.truth.frames:,}", cost))
    columns = {head: [cost[head] for cost in costs if head in cost] for head in heads}
    is_better = {head: head.startswith("tshark") for head in heads}
    worst = {head: (min if is_better[head] else max)(of) for head, of in columns.items()}
    best = {head: (max if is_better[head] else min)(of) for head, of in columns.items()}
    middle = {head: statistics.median(of) for head, of in columns.items()}
    for name, of in (("best", best), ("median", middle), ("worst", worst)):
        lines.append(line(f"**{name}**", "", of))
    return lines


if __name__ == "__main__":
    main()
