"""Troubles of networks at real speed into `modlens doctor - --follow`: when they are reported.

    python -m bench.network_events [KIND ...]

Real clients and servers (pymodbus, libmodbus) on loopback, most with a middleman of sockets that
makes the trouble; dumpcap records. All kinds run at the same time, each on a port of its own: first
without the trouble, then with it, then without it until its end is reported. "Enough evidence" is
where `modlens doctor` diagnoses the cause from what was recorded up to then. Linux, as root.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pymodbus.server import ModbusTcpServer

from analyzer import decode
from bench.support.network_plays import PLAYS, Play
from tests.support.pymodbus_server import serving
from tests.support.trouble_scenarios import Manner, device

FIRST_PORT, STEP_S = 15_600, 5.0
HEADER, RECORD = 24, 16
JUDGING = threading.Lock()


@dataclass(slots=True)
class Played:
    """What was reported, in seconds from the beginning of the trouble, or from its end."""

    evidence: float | None
    begun: dict[str, float]
    ended: dict[str, float]
    false: int


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def copy(capture: subprocess.Popen[bytes], path: Path, doctor: subprocess.Popen[bytes]) -> None:
    """Pass what dumpcap writes to a file and to the doctor."""
    assert capture.stdout is not None
    assert doctor.stdin is not None
    with path.open("wb") as file, contextlib.suppress(BrokenPipeError):
        while block := capture.stdout.read1(65_536):  # type: ignore[attr-defined]
            file.write(block)
            file.flush()
            doctor.stdin.write(block)
            doctor.stdin.flush()
        doctor.stdin.close()


def events_of(path: Path) -> Iterator[tuple[str, str, float]]:
    """Give what happened, the code, and when."""
    for line in path.read_text("utf-8").splitlines():
        row = json.loads(line)
        yield row["event"], row["code"], datetime.fromisoformat(row["time"]).timestamp()


def evidence_of(path: Path, code: str, port: int, began: float) -> float | None:
    """Find when a doctor of everything up to then diagnoses the code for the first time."""
    data = path.read_bytes()
    cuts: list[tuple[float, int]] = []
    at = HEADER
    while at + RECORD <= len(data):
        seconds, micros, length = struct.unpack_from("<III", data, at)
        cuts.append((seconds + micros / 1e6 - began, at))
        at += RECORD + length
    part = path.with_name("part.pcap")
    due = STEP_S
    for when, end in cuts:
        if when >= due:
            part.write_bytes(data[:end])
            rows = decode(part, ports=(port,)).doctor()["diagnoses"]
            if any(row["code"] == code and row["certainty"] == "diagnosed" for row in rows):
                return when
            due = when + STEP_S
    return None


def live(name: str, port: int, options: argparse.Namespace) -> Played:
    """Play one kind and read what is reported."""
    play: Play = PLAYS[name](port)
    devices = [device(1), device(2, Manner(shift=500))]
    with tempfile.TemporaryDirectory() as folder_name, contextlib.ExitStack() as opened:
        folder = Path(folder_name)
        events, capture_file = folder / "events.jsonl", folder / "capture.pcap"
        words = ["doctor", "-", "--follow", "--port", str(port), "-o", f"events:{events}"]
        doctor = subprocess.Popen(
            [sys.executable, "-m", "analyzer", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        capture = subprocess.Popen(
            ["dumpcap", "-q", "-P", "-i", "lo", "-f", f"tcp port {port}", "-w", "-"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        copier = threading.Thread(target=copy, args=(capture, capture_file, doctor), daemon=True)
        copier.start()
        time.sleep(2)
        opened.enter_context(
            serving(lambda: ModbusTcpServer(devices, address=("127.0.0.1", play.behind)))
        )
        play.begin()
        time.sleep(options.before)
        false = sum(what == "begin" for what, _, _ in events_of(events)) if events.exists() else 0
        play.trouble.set()
        began = time.time()
        time.sleep(options.length)
        play.trouble.clear()
        over, until = time.time(), time.monotonic() + options.after
        while time.monotonic() < until:
            time.sleep(1)
            happened = list(events_of(events)) if events.exists() else []
            begun = {code for what, code, _ in happened if what in {"begin", "change"}}
            if begun and begun <= {code for what, code, _ in happened if what == "end"}:
                break
        play.over.set()
        time.sleep(1)
        capture.send_signal(signal.SIGINT)
        capture.wait(30)
        copier.join(30)
        doctor.wait(60)
        play.end()
        first: dict[str, float] = {}
        last: dict[str, float] = {}
        for what, code, at in events_of(events):
            if what == "end":
                last[code] = at - over
            else:
                first.setdefault(code, at - began)
        with JUDGING:
            evidence = evidence_of(capture_file, play.code, port, began)
        if options.keep:
            kept = Path(options.keep) / f"{name}.pcap"
            kept.write_bytes(capture_file.read_bytes())
    return Played(evidence, first, last, false)


def main() -> None:
    """Play all kinds at the same time and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(PLAYS))
    parser.add_argument("--before", type=float, default=40.0)
    parser.add_argument("--length", type=float, default=90.0)
    parser.add_argument("--after", type=float, default=200.0)
    parser.add_argument("--keep", metavar="FOLDER", help="keep the captures there")
    options = parser.parse_args()
    logging.disable()
    names = options.kinds or list(PLAYS)
    with ThreadPoolExecutor(len(names)) as pool:
        jobs = [
            pool.submit(live, name, FIRST_PORT + 2 * at, options) for at, name in enumerate(names)
        ]
        played = dict(zip(names, [job.result() for job in jobs], strict=True))
    in_time = over = 0
    for name, one in played.items():
        code = PLAYS[name].code
        begun, ended = one.begun.get(code), one.ended.get(code)
        is_soon = begun is not None and begun <= (one.evidence or 0.0) + 60
        in_time += is_soon
        over += ended is not None
        evidence = "never enough" if one.evidence is None else f"evidence at {one.evidence:.0f} s"
        begin = "never" if begun is None else f"{begun:.0f} s"
        end = "not cleared" if ended is None else f"{ended:.0f} s after its end"
        say(f"{name}: {code}: {evidence}, event at {begin}, {end}")
        others = sorted(set(one.begun) - {code})
        if others or one.false:
            say(f"{name}: other events: {others}, {one.false} before the trouble")
    say(f"{in_time} of {len(played)} within 60 s of enough evidence, {over} of them cleared")


if __name__ == "__main__":
    main()
