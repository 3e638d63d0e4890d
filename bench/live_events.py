"""Troubles at real speed through ptys into `modlens tap`: when they are reported, and over.

    python -m bench.live_events --healthy ok.jsonl noise.jsonl dead.jsonl ...

Each recording (chunks: a time and bytes in hex in each line) is played on a line of its own, all
at the same time: the healthy one first, the trouble `--times` times, then the healthy one until
the end of the trouble is reported, for `--after` seconds at most. "Enough evidence" is where
`modlens doctor` diagnoses the code from what was played up to then. Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import signal
import subprocess
import sys
import tempfile
import termios
import threading
import time
import tty
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from analyzer import decode

Chunks = list[tuple[float, bytes]]
EARLIEST_S, STEP_S = 2.0, 2.0
JUDGING = threading.Lock()
"""Evidence is looked for after the lines have been played, one recording after the other."""


@dataclass(slots=True)
class Played:
    """What a tap reported: begins after the first chunk, ends after the last one, in seconds."""

    name: str
    evidence: dict[str, float]
    begun: dict[str, float]
    ended: dict[str, float]
    false: int


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def chunks(path: Path) -> Chunks:
    """The bytes of a recording with their times from its beginning."""
    rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    first = rows[0]["t"]
    return [(row["t"] - first, bytes.fromhex(row["hex"])) for row in rows]


def play(line: int, recording: Chunks, until: float = float("inf")) -> None:
    """Write a recording at its own speed."""
    began = time.monotonic()
    for at, data in recording:
        if time.monotonic() > until:
            return
        time.sleep(max(0.0, began + at - time.monotonic()))
        os.write(line, data)


def opened(baud: int) -> tuple[int, int]:
    """Open a line: the end to write to, and the one that a tap may open."""
    far, near = pty.openpty()
    tty.setraw(near)
    settings = termios.tcgetattr(near)
    settings[4] = settings[5] = getattr(termios, f"B{baud}")
    termios.tcsetattr(near, termios.TCSANOW, settings)
    return far, near


def events_of(path: Path) -> Iterator[tuple[str, str, float]]:
    """Give what happened, the code, and when."""
    for line in path.read_text("utf-8").splitlines():
        row = json.loads(line)
        yield row["event"], row["code"], datetime.fromisoformat(row["time"]).timestamp()


def evidence_of(recording: Chunks, folder: Path, line: str) -> dict[str, float]:
    """Find when a doctor of everything up to then diagnoses a code for the first time."""
    found: dict[str, float] = {}
    at = EARLIEST_S
    while at < recording[-1][0] + STEP_S:
        part = [f'{{"t": {1.7e9 + t:.6f}, "hex": "{b.hex()}"}}\n' for t, b in recording if t <= at]
        (folder / "part.jsonl").write_text("".join(part), "utf-8")
        for row in decode(folder / "part.jsonl", line=line).doctor()["diagnoses"]:
            if row["certainty"] == "diagnosed":
                found.setdefault(row["code"], at)
        at += STEP_S
    return found


def live(path: Path, healthy: Chunks, options: argparse.Namespace) -> Played:
    """Play one recording and read what the tap reports."""
    trouble = chunks(path)
    length = trouble[-1][0] + 0.5
    looped = [
        (at + number * length, data) for number in range(options.times) for at, data in trouble
    ]
    far, near = opened(int(options.line.split("-")[0]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "events.jsonl"
        words = [
            "tap",
            os.ttyname(near),
            "--line",
            options.line,
            "-o",
            f"events:{file}",
            "--doctor",
        ]
        tap = subprocess.Popen(
            [sys.executable, "-m", "analyzer", *words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        assert tap.stderr is not None
        tap.stderr.readline()
        threading.Thread(target=tap.stderr.read, daemon=True).start()
        play(far, healthy)
        false = sum(what == "begin" for what, _, _ in events_of(file))
        began = time.time()
        play(far, looped)
        over, until = time.time(), time.monotonic() + options.after
        while time.monotonic() < until:
            play(far, healthy, until)
            happened = list(events_of(file))
            open_now = {code for what, code, _ in happened if what == "begin"}
            if open_now <= {code for what, code, _ in happened if what == "end"}:
                break
        tap.send_signal(signal.SIGINT)
        tap.wait(60)
        os.close(far)
        os.close(near)
        begun: dict[str, float] = {}
        ended: dict[str, float] = {}
        for what, code, at in events_of(file):
            if what == "begin":
                begun.setdefault(code, at - began)
            if what == "end":
                ended[code] = at - over
        with JUDGING:
            evidence = evidence_of(looped, folder, options.line)
    return Played(path.stem, evidence, begun, ended, false)


def main() -> None:
    """Play all recordings at the same time and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--healthy", required=True, type=Path)
    parser.add_argument("--line", default="19200-8N1")
    parser.add_argument("--times", type=int, default=2)
    parser.add_argument("--after", type=float, default=180.0)
    options = parser.parse_args()
    healthy = chunks(options.healthy)
    with ThreadPoolExecutor(len(options.recordings)) as pool:
        played = list(pool.map(lambda path: live(path, healthy, options), options.recordings))
    in_time = over = expected = 0
    for one in played:
        for code, at in one.evidence.items():
            begun = one.begun.get(code)
            expected += 1
            in_time += begun is not None and begun <= at + 60
            over += begun is not None and code in one.ended
            words = "never" if begun is None else f"{begun:.0f} s"
            end = f"{one.ended[code]:.0f} s after its end" if code in one.ended else "not cleared"
            say(f"{one.name}: {code}: evidence at {at:.0f} s, event at {words}, {end}")
        others = sorted(set(one.begun) - set(one.evidence))
        if others or one.false:
            say(f"{one.name}: other events: {others}, {one.false} before the trouble")
    say(f"{in_time} of {expected} within 60 s of enough evidence, {over} of {expected} cleared")


if __name__ == "__main__":
    main()
