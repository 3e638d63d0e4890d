"""Tries the tap for gateways where it is meant for: `make try-gateway`.

    python -m release.try_gateway x86_64 aarch64 armv7

A binary for another processor runs under qemu-user; being static, it needs nothing else. It listens
to a pseudo terminal, with line settings that are given and with such that it finds; the rows that
it prints have to be those that this machine's modlens decodes of its recording.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from release.gateways import binary
from release.rust import ROOT
from release.targets import GATEWAYS, MACHINES
from release.try_wheel import LINE, common_environment, listen, run

COUNT = 20
OF_THE_FILE = {"source"}
"""Columns that say where a row is from: for the tap the port, for the other the recording."""


def command(name: str) -> list[str]:
    """The words that start the binary for a machine on this one."""
    machine = GATEWAYS[name].machine
    emulator = [] if machine == platform.machine() else [MACHINES[machine].emulator]
    return [*emulator, str(binary(name))]


def try_recording(name: str, folder: Path) -> None:
    """The rows of the tap are those of its recording."""
    words = [*command(name), "PORT", *LINE, "--record", "bus.pcapng", "--count", str(COUNT)]
    printed = rows_of(listen(words, common_environment(), folder))
    here = [sys.executable, "-m", "analyzer", "decode", str(folder / "bus.pcapng")]
    env = {**common_environment(), "PYTHONPATH": str(ROOT)}
    decoded = rows_of(run([*here, "--replay", "--to", "jsonl"], env, folder))
    if len(printed) != COUNT or decoded[:COUNT] != printed:
        raise SystemExit(f"{name}: printed\n{printed}\nrecorded\n{decoded}")


def try_search(name: str, folder: Path) -> None:
    """Line settings are found."""
    words = [*command(name), "PORT", "--count", "2"]
    rows = rows_of(listen(words, common_environment(), folder))
    if [row["data"] for row in rows] != [[7], [7]]:
        raise SystemExit(f"{name}: without --line: {rows}")


def rows_of(text: str) -> list[dict[str, Any]]:
    """JSON lines without the columns that differ by right."""
    rows = map(json.loads, text.splitlines())
    return [{key: row[key] for key in row if key not in OF_THE_FILE} for row in rows]


def main() -> int:
    """Try the binaries for the machines that are named; gives the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="+", choices=GATEWAYS, metavar="MACHINE")
    for name in parser.parse_args().machines:
        start = time.monotonic()
        with tempfile.TemporaryDirectory() as place:
            try_recording(name, Path(place))
            try_search(name, Path(place))
        seconds = time.monotonic() - start
        sys.stdout.write(f"{name}: its rows are those of its recording, {seconds:.0f} s\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
