"""What decoding costs, beside every peer that is installed: whole processes, in turn, in one run.

`make bench`, or `python -m bench.compare [MEGABYTES]`. Traffic is generated with the truth about it
(`bench.support.workload`), and what modlens exports is compared with that in the same run. Each
program runs once, then each again: what else goes on in the machine hits all alike. The median of
the CPU seconds counts, of ours without the start of an interpreter that imports modlens; of tshark
without what it takes for one packet. Peers that are slow get a part of the traffic; costs are per
frame. Ours write files, but for one row; tshark prints, to /dev/null.

- `--yardstick FOLDER` (`YARDSTICK=FOLDER make bench`): also `limit.rs` in there, a program that
  does nothing but what has to be done. Ratios to it say how far from one core's limit we are.
- `--page`: writes the table into docs/figures.md, without the yardstick, which others do not have.
"""

from __future__ import annotations

import argparse
import csv
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

from bench.support.processes import measured
from bench.support.workload import Truth, Workload, read_truth

ROOT = Path(__file__).parent.parent
COLUMNS = (
    "time,mbap_id,unit,function,address,quantity,data,exception,request_frame,response_time_us"
)
FIELDS = (
    "frame.time_epoch", "mbtcp.trans_id", "mbtcp.unit_id", "modbus.func_code",
    "modbus.reference_num", "modbus.word_cnt", "modbus.regval_uint16", "modbus.exception_code",
    "modbus.request_frame", "modbus.response_time",
)  # fmt: skip
MAX_OPEN_SHARE = 0.001
"""The most requests of a log with times of which it may be open whether they were answered."""
PARTS = {"bytes": 64, "part": 8, "little": 1}
"""How the traffic is divided: all of it, an eighth, and a sixty-fourth for the slowest."""

ARROW = """
import sys, modlens, pyarrow
rows = modlens.decode(sys.argv[1], read_as="raw", mode="rtu").transactions
for batch in pyarrow.RecordBatchReader.from_stream(rows.select(*sys.argv[2].split(","))): pass
"""
PYMODBUS = """
import sys
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from bench.support.workload import Workload, frame
sides = (FramerRTU(DecodePDU(True)), FramerRTU(DecodePDU(False)))
pairs = [[b and frame(b) for b in pair] for pair in Workload().exchanges]
if sys.argv[1] == "decode":
    for pair in pairs:
        for framer, data in zip(sides, pair):
            if data: framer.handleFrame(data, 0, 0)
"""


@dataclass
class Program:
    """A program that is timed: its words, the frames that it gets, and what its start costs.

    `start` is the name of the program whose cost is taken off; `base` that of the yardstick.
    """

    name: str
    words: list[str]
    frames: int
    start: str = ""
    base: str = ""
    cpu: list[float] = field(default_factory=list)
    peak: float = 0.0

    def run(self, scratch: Path) -> None:
        """Run it once."""
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        # Python may keep its bytecode, as in any installation.
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        # pyarrow imports numpy, whose OpenBLAS begins threads that spin without any work.
        environment["OPENBLAS_NUM_THREADS"] = "1"
        for old in scratch.iterdir():
            old.unlink()
        cpu, peak = measured(self.words, environment)
        self.cpu.append(cpu)
        self.peak = max(self.peak, peak)


@dataclass(frozen=True)
class Files:
    """The traffic as files: name of the part -> file."""

    raw: Path
    log: Path
    captures: dict[str, Path]
    frames: dict[str, int]
    scratch: Path


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("megabytes", type=int, nargs="?", default=64, help="how much RTU to read")
    parser.add_argument("--runs", type=int, default=5, help="runs of each; their median counts")
    parser.add_argument("--yardstick", metavar="FOLDER", help="a folder with limit.rs")
    parser.add_argument("--page", action="store_true", help="write the table into docs/figures.md")
    parser.add_argument("--no-peers", action="store_true", help="modlens alone")
    options = parser.parse_args()
    workload = Workload()
    with tempfile.TemporaryDirectory() as name:
        files = written(workload, Path(name), options.megabytes)
        check(
            files,
            workload.truth.times(options.megabytes),
            workload.equal_pairs_behind_silence * options.megabytes,
        )
        programs = own(files)
        if not options.no_peers:
            programs += peers(files, workload.truth.frames)
        limits = []
        if options.yardstick:
            limits = yardstick(files, Path(options.yardstick), Path(name))
        for _ in range(options.runs):
            for program in programs + limits:
                program.run(files.scratch)
    sys.stdout.write("\n".join(table(programs + limits)) + "\n")
    own_peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sys.stdout.write(f"(no peak is below that of this script, {own_peak:.0f} MiB)\n")
    if options.page:
        write_page(table(programs))


def written(workload: Workload, folder: Path, megabytes: int) -> Files:
    """The traffic in all forms."""
    counts = {part: max(1, megabytes * size // 64) for part, size in PARTS.items()}
    captures = {
        part: workload.write_capture(folder / f"{part}.pcap", count)
        for part, count in counts.items()
    }
    Workload(1).write_capture(folder / "one.pcap", 1)
    scratch = folder / "out"
    scratch.mkdir()
    return Files(
        workload.write_raw(folder / "all.bin", megabytes),
        workload.write_log(folder / "all.hex", megabytes),
        {**captures, "one": folder / "one.pcap"},
        {part: workload.truth.frames * count for part, count in counts.items()},
        scratch,
    )


def check(files: Files, truth: Truth, open_pairs: int) -> None:
    """Compare what modlens exports with what was generated, and say so; end where they differ.

    `open_pairs` are the exchanges that may be missing in the log; see `compared`.
    """
    requests = truth.ok + truth.exception + truth.no_response
    for path in (files.raw, files.captures["bytes"], files.log):
        out = files.scratch / "check.csv"
        run = [*export(path, out), "--columns", "status,function,data"]
        subprocess.run(run, check=True, cwd=ROOT)
        with out.open(newline="") as file:
            found = replace(read_truth(csv.DictReader(file)), frames=truth.frames)
        verdict = compared(found, truth, open_pairs if path == files.log else 0)
        sys.stdout.write(
            f"{path.suffix}: {requests:,} requests, {truth.registers:,} registers: {verdict}\n"
        )


def compared(found: Truth, truth: Truth, open_pairs: int) -> str:
    """What an export says beside the truth, in words; `SystemExit` where it says something else.

    A write of one register is answered by the same bytes. Right after a request without a
    response, the times of a log leave open which of the two frames is what, so that they may not be
    paired. There are `open_pairs` of them; nothing else may differ.

    >>> compared(Truth(ok=3000, no_response=9), Truth(ok=3002, no_response=5), 2)
    'as generated, but for 2 writes after a silent unit, whose equal frames are 4 unpaired rows'
    """
    if found == truth:
        return "as generated"
    lost, rows = truth.ok - found.ok, found.no_response - truth.no_response
    others = replace(found, ok=truth.ok, no_response=truth.no_response)
    most = min(open_pairs, MAX_OPEN_SHARE * (truth.ok + truth.exception + truth.no_response))
    if others != truth or not 0 < lost <= most or not lost <= rows <= 2 * lost:
        raise SystemExit(f"exported were {found}, but generated were {truth}")
    return (
        f"as generated, but for {lost:,} writes after a silent unit,"
        f" whose equal frames are {rows:,} unpaired rows"
    )


def export(path: Path, out: Path | None) -> list[str]:
    """The words that export a recording; without `out` as JSON lines to standard output."""
    target = ["--to", "jsonl"] if out is None else ["-o", str(out)]
    # With several threads more CPU is spent, and the peers have one.
    words = ["export", *source(path), "--threads", "1", *target]
    return [sys.executable, "-m", "analyzer", *words]


def source(path: Path) -> list[str]:
    """The words that read a recording."""
    mode = {".bin": "rtu", ".ascii": "ascii"}.get(path.suffix)
    return [str(path), *(["--from", "raw", "--mode", mode] if mode else [])]


def own(files: Files) -> list[Program]:
    """What modlens does."""
    frames, capture, out = files.frames["bytes"], files.captures["bytes"], files.scratch
    begin, ten = "modlens, start", ["--columns", COLUMNS]
    python = [sys.executable, "-c"]
    stats = [sys.executable, "-m", "analyzer", "stats", *source(files.raw)]
    programs = [
        Program(begin, [*python, "import modlens, analyzer.api, analyzer.cli.outputs"], 0),
        Program("statistics of raw RTU", stats, frames, begin, "yardstick, columns"),
        Program(
            "raw RTU to CSV", [*export(files.raw, out / "a.csv"), *ten], frames, begin,
            "yardstick, CSV",
        ),
        Program("log with times to CSV", [*export(files.log, out / "a.csv"), *ten], frames, begin),
        Program(
            "Modbus/TCP pcap to CSV", [*export(capture, out / "a.csv"), *ten], frames, begin,
            "yardstick, pcap to CSV",
        ),
        Program("Modbus/TCP pcap to JSON lines", export(capture, out / "a.jsonl"), frames, begin),
        # What tshark prints also goes there: without the file, which the system takes longest for.
        Program("the same, printed to /dev/null", export(capture, None), frames, begin),
    ]  # fmt: skip
    if installed("pyarrow"):
        arrow = [*python, ARROW, str(files.raw), COLUMNS]
        programs += [
            Program("pyarrow, start", [*python, "import modlens, analyzer.api, pyarrow"], 0),
            Program(
                "raw RTU to Arrow", arrow, frames, "pyarrow, start", "yardstick, columns"
            ),
        ]  # fmt: skip
    return programs


def peers(files: Files, block_frames: int) -> list[Program]:
    """What others do that are installed."""
    programs = []
    if shutil.which("tshark"):
        begin = "tshark, start"
        words = ["tshark", "-n", "-r"]
        fields = [f"-e{one}" for one in FIELDS]
        part, little = str(files.captures["part"]), str(files.captures["little"])
        programs += [
            Program(begin, [*words, str(files.captures["one"])], 0),
            Program(
                "tshark -T fields", [*words, part, "-T", "fields", *fields], files.frames["part"],
                begin,
            ),
            Program(
                "tshark -T json", [*words, little, "-T", "json"], files.frames["little"], begin
            ),
        ]  # fmt: skip
    if installed("pymodbus"):
        python = [sys.executable, "-c", PYMODBUS]
        programs += [
            Program("pymodbus, start", [*python, "begin"], 0),
            Program("pymodbus, frames given", [*python, "decode"], block_frames, "pymodbus, start"),
        ]
    return programs


def yardstick(files: Files, folder: Path, build: Path) -> list[Program]:
    """What has to be done and nothing else, by the program in this folder."""
    program = compiled(folder, build)
    frames, raw, out = files.frames["bytes"], str(files.raw), files.scratch / "a.csv"
    capture = str(files.captures["bytes"])
    return [
        Program("yardstick, columns", [str(program), raw, "valss", "0"], frames),
        Program("yardstick, CSV", [str(program), raw, f"bincsv:{out}"], frames),
        Program("yardstick, pcap to CSV", [str(program), capture, f"tcpcsv:{out}"], frames),
    ]


def compiled(yardstick: Path, folder: Path) -> Path:
    """Compiles the program in the folder of the yardstick into the other one."""
    program = folder / "limit"
    rustc = ["rustc", "--edition", "2021", "-O", "-o", str(program), str(yardstick / "limit.rs")]
    subprocess.run(rustc, check=True)
    return program


def table(programs: list[Program]) -> list[str]:
    """The lines of the table, in Markdown."""
    cost = {one.name: statistics.median(one.cpu) for one in programs}
    each = {
        one.name: (cost[one.name] - cost.get(one.start, 0.0)) / one.frames * 1e9
        for one in programs
        if one.frames
    }
    fields = each.get("tshark -T fields")
    has_yardstick = any(one.base in each for one in programs)
    heads = ["", "ns a frame", "frames a second", "peak MiB"]
    heads += ["times `tshark -T fields`"] if fields else []
    heads += ["of the yardstick"] if has_yardstick else []
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    for one in (one for one in programs if one.frames):
        own_cost = max(each[one.name], 0.1)
        cells = [one.name, f"{own_cost:,.0f}", f"{1e9 / own_cost:,.0f}", f"{one.peak:.0f}"]
        cells += [f"{fields / own_cost:,.3g}"] if fields else []
        if has_yardstick:
            cells.append(f"{own_cost / each[one.base]:.1f}" if one.base in each else "")
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def write_page(lines: list[str]) -> None:
    """Replaces the first table under "Speed" in docs/figures.md."""
    page = ROOT / "docs" / "figures.md"
    head, mark, rest = page.read_text().partition("\n## Speed\n")
    before, _, behind = rest.partition("\n| ")
    while behind.partition("\n")[2].startswith("|"):
        behind = behind.partition("\n")[2]
    behind = behind.partition("\n")[2]
    page.write_text(f"{head}{mark}{before}\n" + "\n".join(lines) + "\n" + behind)


def installed(module: str) -> bool:
    """Whether a Python package is there."""
    run = [sys.executable, "-c", f"import {module}"]
    return subprocess.run(run, check=False, capture_output=True).returncode == 0


if __name__ == "__main__":
    main()
