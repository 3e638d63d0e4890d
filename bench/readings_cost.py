"""What readings by a profile cost on top of decoding: `make bench-readings`.

CPU seconds in one process, three passes over the same raw RTU bytes: one that builds transactions
and nothing else; one that also builds the readings without a profile (a row a register) and looks
at the value of each, because a filter asks for it; and one that does the same with a profile bound
to all units, so that each value is converted. Holding registers, most of the traffic, are points of
the profile: whole numbers, floats, scaled ones. Addresses and lengths of the 120 reads are random,
and so is the address of each write.
"""

from __future__ import annotations

import argparse
import sys
import time

import _modlens
from analyzer.sources.files import BLOCK_BYTES
from bench.support.workload import UNITS, traffic

SIZE = 16 << 20
ROUNDS = 7

FIRST = 0x1000
"""The first address that the traffic has registers at (`bench.support.workload`)."""


def profile() -> _modlens.Profile:
    """A point for every register of the traffic: one in four a float, one in four scaled."""
    lines = ["profile = 1"]
    for address in range(FIRST, FIRST + 0x1080, 4):
        for offset, keys in (
            (0, ""),
            (1, "scale = 0.1"),
            (2, 'type = "f32"'),
        ):
            lines += ["[[registers]]", f'at = "hr:{address + offset}"', keys]
            lines += [f'name = "r{address + offset}"']
    return _modlens.Profile("\n".join(lines), "toml")


def run(data: bytes, points: _modlens.Profile | None, *, readings: bool) -> tuple[float, int]:
    """CPU seconds of a pass, and the readings that it converted."""
    tables = ("transactions", "readings") if readings else ("transactions",)
    begin = time.process_time()
    core = _modlens.Session(_modlens.Functions(), tables=tables)
    if points is not None:
        core.bind(points, UNITS)
    bus = core.add_bus("bench", source="bench", mode="rtu")
    every = _modlens.Predicate("readings", '["cmp", ">", ["col", "value"], ["num", 1e300]]')
    count = 0
    for start in range(0, len(data), BLOCK_BYTES):
        core.feed(bus, data[start : start + BLOCK_BYTES])
        batch = core.take()
        if readings:
            count += len(batch.readings)
            batch.readings.where(every)
    core.flush()
    core.take()
    return time.process_time() - begin, count


def main() -> None:
    """Print all three, and what is on top; best of some rounds, in turn."""
    argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "").parse_args()
    data = b"".join(ask + answer for ask, answer in traffic(SIZE))
    points = profile()
    passes = ((None, False), (None, True), (points, True))
    rounds = [
        [run(data, bound, readings=readings) for bound, readings in passes] for _ in range(ROUNDS)
    ]
    plain, bare, read = (
        min(seconds for seconds, _ in column) for column in zip(*rounds, strict=True)
    )
    registers, values = rounds[0][1][1], rounds[0][2][1]
    out = sys.stdout
    out.write(f"{len(data) >> 20} MiB of RTU decoded: {plain:.3f} CPU s\n")
    out.write(f"with {registers:,} readings without a profile: {bare:.3f} CPU s\n")
    out.write(f"with {values:,} readings by a profile: {read:.3f} CPU s\n")
    out.write(f"readings cost {100 * (read / plain - 1):.0f} % on top of decoding, ")
    out.write(f"{(read - plain) / values * 1e9:.1f} ns each; ")
    out.write(f"the profile {100 * (read / bare - 1):.0f} % on top of bare registers\n")


if __name__ == "__main__":
    main()
