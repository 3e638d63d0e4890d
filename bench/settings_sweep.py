"""Whether line settings are found by listening: every standard rate and character format.

    python -m bench.settings_sweep              # each case once: minutes
    python -m bench.settings_sweep --seeds 3    # and with other traffic

The line is made of bits: polling at 20 % load, received by a UART with whatever settings the search
tries, as chips do (`tests/support/uart.py`). Right are the settings that the senders have; a second
stop bit after a parity bit is silence to any receiver (8E2 is heard as 8E1). Seconds are those of
traffic. Ends with status 1 if a case fails or takes ten seconds.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time

from analyzer.line import parse_line
from tests.support.settings_search import (
    ASCII,
    BAUDS,
    MAX_S,
    RTU,
    SettingsSearch,
    search_settings,
    traffic,
)

SHAPES = [(shape, "rtu") for shape in RTU] + [(shape, "ascii") for shape in ASCII]


def heard_as(shape: str) -> str:
    """The character format as a receiver can know it: 8M1 and 8N2 are the same on the line."""
    return shape.replace("2", "1") if shape[:2] in ("8E", "8O") else shape


def case(baud: int, shape: str, mode: str, seed: int) -> tuple[bool, float]:
    """Whether the right settings were found, and after how many seconds of traffic."""
    search = SettingsSearch()
    seconds = search_settings(search, traffic(parse_line(f"{baud}-{shape}"), mode, seed))
    found = search.found
    right = found is not None and (str(found.line), found.mode) == (
        f"{baud}-{heard_as(shape)}",
        mode,
    )
    return right, seconds


def main() -> int:
    """Print a line for each character format, then the totals."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=1)
    seeds, begun = parser.parse_args().seeds, time.process_time()
    taken: list[float] = []
    failed: list[str] = []
    for shape, mode in SHAPES:
        here = []
        for baud in sorted(BAUDS):
            for seed in range(1, seeds + 1):
                right, seconds = case(baud, shape, mode, seed)
                here.append(seconds)
                if not right or seconds >= MAX_S:
                    failed.append(f"{baud}-{shape} {mode}, seed {seed}, {seconds:.1f} s")
        taken += here
        sys.stdout.write(
            f"{shape} {mode:5} {len(here)} cases: p50 {statistics.median(here):.2f} s,"
            f" at most {max(here):.2f} s\n"
        )
        sys.stdout.flush()
    sys.stdout.write(
        f"found {len(taken) - len(failed)} of {len(taken)}: p50 {statistics.median(taken):.2f} s,"
        f" at most {max(taken):.2f} s of traffic; {time.process_time() - begun:.0f} CPU s\n"
    )
    sys.stdout.writelines(f"not found: {one}\n" for one in failed)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
