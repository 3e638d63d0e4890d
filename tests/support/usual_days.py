"""Figures about baselines: alerts on ordinary days, and what `modlens diff` finds between days.

    python -m tests.support.usual_days alarms --days 3     # of 24 hours each
    python -m tests.support.usual_days diff --pairs 50 --hours 24

    python -m tests.support.usual_days recordings ../pcap/*.pcap*    # and our healthy ones

`alarms` learns a baseline from two days and reports the alerts of further ones, by severity: of
`modlens security --baseline`, and those that `modlens decode --baseline` reports while it reads.
`diff` compares pairs of days, half with a planted change. `recordings` reports the alerts of
`modlens security` in the healthy recordings of captures/, and in those named.
"""

from __future__ import annotations

import argparse
import json
import random
import struct
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from tests.analyzer.test_baseline import CHANGES, ORDINARY, day
from tests.support.packets import Packet, write_capture

__all__ = ["alarms", "ordinary_day"]

HMI, HISTORIAN, ENGINEER, SERVER = "10.0.0.10", "10.0.0.11", "10.0.0.12", "10.0.0.3"
HOUR_S = 3600.0
ROOT = Path(__file__).parents[2]
POLLS = ((1, 3, 100, 10), (1, 4, 0, 4), (2, 3, 40, 2), (3, 1, 0, 16))

Event = tuple[float, str, bytes, bytes | None, float]


def ordinary_day(path: Path, seed: int, *, hours: float = 24, begin_hour: float = 0) -> str:
    """Write a day of a plant with shifts; gives its path.

    From 6 to 22 h the HMI polls every two seconds and operators write setpoints; by night it polls
    every ten. A historian reads once a minute, an engineer looks at one device at noon. Devices
    refuse or miss a request in a thousand, and are slower when the plant runs.
    """
    chance = random.Random(seed)
    begin, end = begin_hour * HOUR_S, (begin_hour + hours) * HOUR_S
    packets: list[Packet] = []
    ids: Counter[str] = Counter()
    for time, client, request, response, delay in events(begin, end, chance):
        ids[client] += 1
        head = struct.pack(">HH", ids[client] & 0xFFFF, 0)
        for sender, pdu, at in ((client, request, time), (SERVER, response, time + delay)):
            if pdu is not None:
                ends = (client, SERVER) if sender == client else (SERVER, client)
                data = head + struct.pack(">H", len(pdu)) + pdu
                packets.append(Packet(at, *ends, data, sender == client))
    write_capture(path, packets, start=1_700_006_400 + 86_400 * seed)
    return str(path)


def events(begin: float, end: float, chance: random.Random) -> Iterator[Event]:
    """Requests and responses of the time from `begin` to `end`, in seconds of the day."""
    level, time, next_minute = 500, begin, begin
    while time < end:
        is_shift = 6 * HOUR_S <= time % 86_400 < 22 * HOUR_S
        for place, poll in enumerate(POLLS):
            level = min(max(level + chance.randint(-4, 4), 100), 900)
            at = time + place * 0.15 + chance.uniform(0, 0.04)
            yield exchange(HMI, at, poll, level, chance, slow=is_shift)
        if time >= next_minute:
            next_minute += 60
            for place, poll in enumerate(POLLS[:2]):
                yield exchange(
                    HISTORIAN, time + 0.8 + place * 0.1, poll, level, chance, slow=is_shift
                )
        if is_shift and chance.random() < 0.001:
            register = chance.choice((200, 201))
            write = struct.pack(">BBHH", 1, 6, register, chance.choice((180, 200, 210, 220, 240)))
            yield time + 1.2, HMI, write, write, 0.03
        if abs(time % 86_400 - 12 * HOUR_S) < 300 and chance.random() < 0.2:
            yield exchange(ENGINEER, time + 1.4, (2, 3, 0, 20), level, chance, slow=True)
        time += (2.0 if is_shift else 10.0) + chance.uniform(-0.05, 0.05)


def exchange(  # noqa: PLR0913 - what an exchange is made of
    client: str,
    time: float,
    poll: tuple[int, int, int, int],
    level: int,
    chance: random.Random,
    *,
    slow: bool,
) -> Event:
    """A read with its response; one in two thousand is refused, and as many are not answered."""
    unit, function, address, quantity = poll
    request = struct.pack(">BBHH", unit, function, address, quantity)
    size = (quantity + 7) // 8 if function == 1 else 2 * quantity
    values = struct.pack(f">{(size + 1) // 2}H", *(level + n for n in range((size + 1) // 2)))
    response: bytes | None = struct.pack(">BBB", unit, function, size) + values[:size]
    luck = chance.random()
    if luck < 0.0005:
        response = struct.pack(">BBB", unit, function | 0x80, 6)
    elif luck < 0.001:
        response = None
    return time, client, request, response, chance.lognormvariate(-3.7 if slow else -4.0, 0.3)


def run(*words: str) -> subprocess.CompletedProcess[str]:
    """Run modlens."""
    command = [sys.executable, "-m", "analyzer", *words]
    return subprocess.run(command, capture_output=True, text=True, check=True)


def alarms(folder: Path, days: int, *, hours: float = 24, begin_hour: float = 0) -> list[list[str]]:
    """Report the alerts of each ordinary day, severity first: at once, and while reading."""
    usual = folder / "usual.toml"
    size = {"hours": hours, "begin_hour": begin_hour}
    learned = [
        ordinary_day(folder / f"learned{seed}.pcap", 900 + seed, **size) for seed in range(2)
    ]
    run("baseline", *learned, "-o", str(usual))
    found = []
    for seed in range(days):
        path = ordinary_day(folder / "day.pcap", seed, **size)
        rows = run("security", path, "--baseline", str(usual), "--to", "jsonl").stdout.splitlines()
        whole = [
            f"{row['severity']} {row['code']}: {row['sentence']}" for row in map(json.loads, rows)
        ]
        said = run("decode", path, "--baseline", str(usual), "-o", str(folder / "day.csv")).stderr
        marks = (" high ", " medium ", " low ", " info ")
        live = [line for line in said.splitlines() if any(mark in line for mark in marks)]
        found.append([*whole, *(f"while reading: {line}" for line in live)])
    return found


def recordings(others: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Each recording with its alerts, severity first."""
    healthy = []
    for path in sorted((ROOT / "captures").glob("*/about.toml")):
        about = tomllib.loads(path.read_text())
        if about.get("healthy"):
            line = ["--line", about["line"]] if about.get("line") else []
            healthy.append([str(path.parent / about["file"]), *line])
    for words in [*healthy, *([other] for other in others)]:
        rows = map(json.loads, run("security", *words, "--to", "jsonl").stdout.splitlines())
        name = Path(words[0])
        yield (
            f"{name.parent.name}/{name.name}",
            [f"{row['severity']} {row['code']}" for row in rows],
        )


def differences(
    folder: Path, pairs: int, hours: float, seed: int = 5000
) -> tuple[int, int, list[str]]:
    """Compare pairs of days; gives planted changes that were found, false ones, and their texts."""
    found, false, texts = 0, 0, []
    codes = sorted(CHANGES)
    for number in range(pairs):
        code = codes[number % len(codes)]
        for plant, wanted in ((CHANGES[code], {code}), (ORDINARY, set())):
            seconds = int(hours * HOUR_S)
            before = day(folder / "a.pcap", replace(ORDINARY, seconds=seconds), seed + 2 * number)
            after = day(folder / "b.pcap", replace(plant, seconds=seconds), seed + 1 + 2 * number)
            rows = run("diff", before, after, "--to", "jsonl").stdout.splitlines()
            seen = {row["code"] for row in map(json.loads, rows)}
            found += bool(wanted) and wanted <= seen
            false += len(seen - wanted)
            if seen != wanted:
                texts.append(f"pair {number}, planted {wanted or 'nothing'}: {sorted(seen)}")
    return found, false, texts


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("what", choices=("alarms", "diff", "recordings"))
    parser.add_argument("files", nargs="*", help="for recordings: further ones")
    parser.add_argument("--days", type=int, default=1)
    parser.add_argument("--pairs", type=int, default=50)
    parser.add_argument("--hours", type=float, default=24)
    parser.add_argument("--seed", type=int, default=5000, help="of the first pair of diff")
    options = parser.parse_args()
    if options.what == "recordings":
        for recording, texts in recordings(options.files):
            print(recording, *texts, sep="  ")  # noqa: T201
        return
    with tempfile.TemporaryDirectory() as name:
        if options.what == "alarms":
            for number, texts in enumerate(alarms(Path(name), options.days, hours=options.hours)):
                counts = Counter(text.removeprefix("while reading: ").split()[0] for text in texts)
                print(f"day {number}: {len(texts)} alerts {dict(counts)}", *texts, sep="\n  ")  # noqa: T201
        else:
            found, false, texts = differences(
                Path(name), options.pairs, options.hours, options.seed
            )
            texts.append(f"{found} of {options.pairs} planted changes found, {false} false")
            print(*texts, sep="\n")  # noqa: T201


if __name__ == "__main__":
    main()
