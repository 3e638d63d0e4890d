"""Thousands of damaged recordings through the command: nothing may fall.

    python -m tests.faults.mutation_bar --cases 10000

Each case runs in a process of its own, forked from one that has everything loaded. What must hold:
the exit status is 0 to 4, no traceback, no panic, 10 s and 256 MiB are enough, and the frames of
every line cover its bytes without gap and overlap; of a raw recording, they are its bytes. A small
gzip file may hold more text than anything decodes in 10 s: above 100 MB a tenth of a second for
each MB is enough, a third of the speed of plain text (`make bench`).
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import zlib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from tests.faults.mutants import Case, case
from tests.faults.structured import GZIP
from tests.support.forked_command import become_command

__all__ = ["Trouble", "run"]

CPU_S = 10
MB_PER_S = 10
WALL_S = 120
"""A case that waits for something never ends; on a busy machine ten seconds of work take longer."""

MAX_RSS_KIB = 256 * 1024
MB = 1 << 20

OTHER_COMMANDS = [
    ["stats"], ["doctor"], ["doctor", "--to", "json"], ["show", "--frame", "1"],
    ["show", "--txn", "2"], ["map"], ["learn"], ["match"], ["decode", "--to", "table"],
    ["decode", "--to", "txt", "--table", "findings"], ["export", "--to", "csv"],
    ["export", "--to", "pcapng"], ["export", "--to", "pcapng", "--style", "tcp"],
    ["export", "--to", "parquet"], ["export", "--to", "influx"], ["export", "--to", "zeek"],
    ["export", "--to", "jsonl", "--table", "diagnoses"],
    ["export", "--to", "jsonl", "--table", "connections"],
    ["export", "--to", "arrow", "--table", "readings"],
]  # fmt: skip


@dataclass(frozen=True)
class Trouble:
    """A case in which something does not hold, and what."""

    number: int
    words: list[str]
    what: str
    said: str = ""


def run(seed: int, numbers: range, keep: Path | None = None) -> list[Trouble]:
    """Run the cases of these numbers; files of those that fall are left in `keep`."""
    _load()
    troubles = []
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            one = case(seed, number)
            path = Path(folder, one.name)
            path.write_bytes(one.data)
            found = _run_case(one, number, path, Path(folder), random.Random(f"{seed}:{number}"))
            if found is not None:
                troubles.append(found)
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    shutil.copy(path, keep / f"{seed}-{number}-{one.name}")
            path.unlink()
    return troubles


def _load() -> None:
    """Import what the commands import, once and for all children."""
    for name in ("decode", "doctor", "export", "learn", "map", "match", "show", "stats"):
        importlib.import_module(f"analyzer.cli.{name}")
    for name in ("session", "api", "exports.csv", "exports.jsonl", "exports.pcapng"):
        importlib.import_module(f"analyzer.{name}")
    for name in ("rich.console", "rich.table", "tarfile", "bz2", "lzma", "gzip", "email.policy"):
        importlib.import_module(name)


def _run_case(
    one: Case, number: int, path: Path, folder: Path, chance: random.Random
) -> Trouble | None:
    frames = folder / "frames.jsonl"
    frames.unlink(missing_ok=True)
    words = ["export", str(path), *one.words, "-o", f"frames:{frames}"]
    if tiled := chance.random() < 0.65:
        words += ["--columns", "bus,line,connection,frame,byte_offset,hex"]
    else:
        command, *rest = chance.choice(OTHER_COMMANDS)
        words = [command, str(path), *one.words, *rest]
    status, peak_kib, said = _child(words, folder, max(CPU_S, _unpacked(one.data) // MB_PER_S))
    what = None
    if "Traceback" in said or "panicked" in said:
        what = "a traceback"
    elif "modlens --help" in said or f"see modlens {words[0]} --help" in said:
        what = "the case itself is wrong"
    elif status < 0:
        what = f"ended by {signal.Signals(-status).name}"
    elif status > 4:
        what = f"exit status {status}"
    elif peak_kib > MAX_RSS_KIB:
        what = f"{peak_kib // 1024} MiB"
    elif tiled and frames.exists() and not one.is_reimported:
        what = _gap(frames, one)
    return None if what is None else Trouble(number, words, what, said[-2000:])


def _unpacked(data: bytes) -> int:
    """How many MB the members of a gzip file hold; 0 for any other file."""
    size = 0
    while data[:2] == GZIP:
        member = zlib.decompressobj(zlib.MAX_WBITS | 16)
        try:
            while data and not member.eof:
                size += len(member.decompress(data, MB))
                data = member.unconsumed_tail or member.unused_data
        except zlib.error:
            break
        if not member.eof:
            break
    return size // MB


def _child(words: list[str], folder: Path, cpu_s: int) -> tuple[int, int, str]:
    """Run the command in a fork: its exit status (below 0 a signal), peak memory, and messages."""
    messages = folder / "stderr"
    pid = os.fork()
    if pid == 0:
        become_command(words, lambda: _arrange(messages, cpu_s))
    _, status, used = os.wait4(pid, 0)
    return os.waitstatus_to_exitcode(status), used.ru_maxrss, messages.read_text(errors="replace")


def _arrange(messages: Path, cpu_s: int) -> None:
    """Bound what a case may take, and send its messages to a file."""
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.alarm(WALL_S)
    for number, name in ((0, os.devnull), (1, os.devnull), (2, str(messages))):
        flags = os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC
        os.dup2(os.open(name, flags), number)
    sys.stdin, sys.stdout = open(0), open(1, "w")
    sys.stderr = open(2, "w", errors="replace")


def _gap(frames: Path, one: Case) -> str | None:
    """What is wrong with the tiling of these rows; None if nothing is.

    A connection has two streams, one for each side, whose rows do not name them.
    """
    ends: dict[tuple[object, ...], list[int]] = defaultdict(list)
    joined = []
    for text in frames.read_text().splitlines():
        row = json.loads(text)
        streams = ends[tuple(row.get(name) for name in ("bus", "line", "connection"))]
        data, start = bytes.fromhex(row["hex"]), row["byte_offset"]
        sides = 1 if row.get("connection") is None else 2
        if start in streams:
            streams.remove(start)
        elif start != 0 or len(streams) >= sides:
            return f"frame {row['frame']} begins at {start}, not at {streams}"
        streams.append(start + len(data))
        joined.append(data)
    if one.is_raw and b"".join(joined) != one.data:
        return "the frames are not the bytes of the recording"
    return None


def main() -> int:
    """Run as a program; gives the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files of cases that fall")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.cases)
    troubles = run(options.seed, numbers, options.keep)
    for one in troubles:
        print(f"case {one.number}: {one.what}: {' '.join(one.words)}\n{one.said}")  # noqa: T201
    print(f"{options.cases} cases, seed {options.seed}: {len(troubles)} fell")  # noqa: T201
    return bool(troubles)


if __name__ == "__main__":
    sys.exit(main())
