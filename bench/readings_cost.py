"""What readings by a profile cost on top of decoding: `make bench-readings`.

CPU seconds in one process: a pass over raw RTU bytes that builds transactions, and one that also
binds a profile to all units, builds the readings and converts each of them (a filter asks for every
value). Most registers of the traffic are points of the profile: whole numbers, floats, scaled ones.
"""

from __future__ import annotations

import argparse
import sys
import time

import _modlens
from bench.decode_speed import UNITS, traffic

SIZE = 16 << 20
BLOCK = 1 << 18
ROUNDS = 5


def profile() -> _modlens.Profile:
    """A point for every register of the traffic: one in four a float, one in four scaled."""
    lines = ["profile = 1"]
    for address in range(0, 0x1080, 4):
        for offset, keys in (
            (0, ""),
            (1, "scale = 0.1"),
            (2, 'type = "f32"'),
        ):
            lines += ["[[registers]]", f'at = "hr:{address + offset}"', keys]
            lines += [f'name = "r{address + offset}"']
    return _modlens.Profile("\n".join(lines), "toml")


def run(data: bytes, points: _modlens.Profile | None) -> tuple[float, int]:
    """CPU seconds of a pass, and the readings that it converted."""
    tables = ("transactions",) if points is None else ("transactions", "readings")
    begin = time.process_time()
    core = _modlens.Session(_modlens.Functions(), tables=tables)
    if points is not None:
        core.bind(points, UNITS)
    bus = core.add_bus("bench", source="bench", mode="rtu")
    every = _modlens.Predicate("readings", '["cmp", ">", ["col", "value"], ["num", 1e300]]')
    readings = 0
    for start in range(0, len(data), BLOCK):
        core.feed(bus, data[start : start + BLOCK])
        batch = core.take()
        if points is not None:
            readings += len(batch.readings)
            batch.readings.where(every)
    core.flush()
    core.take()
    return time.process_time() - begin, readings


def main() -> None:
    """Print both, and what is on top; best of some rounds, in turn."""
    argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "").parse_args()
    data = b"".join(ask + answer for ask, answer in traffic(SIZE))
    points = profile()
    rounds = [(run(data, None), run(data, points)) for _ in range(ROUNDS)]
    plain = min(seconds for (seconds, _), _ in rounds)
    read = min(seconds for _, (seconds, _) in rounds)
    count = rounds[0][1][1]
    out = sys.stdout
    out.write(f"{len(data) >> 20} MiB of RTU decoded: {plain:.2f} CPU s\n")
    out.write(f"with {count:,} readings: {read:.2f} CPU s\n")
    out.write(f"readings cost {100 * (read / plain - 1):.0f} % on top\n")


if __name__ == "__main__":
    main()
