"""How many values of several registers `modlens learn` finds on random devices.

    python -m tests.support.learn_accuracy --seeds 201-216

Prints the values, those found with type and order, those among the ones that the recording alone
decides, and the wrong claims. The devices are those of `tests.support.random_devices`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.analyzer.cli.test_learn_unseen import count
from tests.support.random_devices import RandomDevice

__all__ = ["main"]


def main() -> None:
    """Measures the seeds that the command line names."""
    parser = argparse.ArgumentParser(description="accuracy of modlens learn")
    parser.add_argument("--seeds", default="201-216", metavar="FIRST-LAST")
    first, last = map(int, parser.parse_args().seeds.split("-"))
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, last + 1):
            plant = RandomDevice(seed)
            path = Path(folder) / f"{seed}.hex"
            path.write_text(plant.recording())
            command = [sys.executable, "-m", "analyzer", "learn", str(path)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            total += count(plant, done.stdout)
    sys.stdout.write(
        f"{total['right']} of {total['all']} values found, {total['found']} of {total['shown']} "
        f"that the recording decides; {total['wrong']} of {total['claims']} claims wrong\n"
    )


if __name__ == "__main__":
    main()
