"""What Wireshark sees in a capture: tshark with its stock settings, whatever the user's are."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

from tests.conftest import TIMEOUT_S, need_program

SEPARATOR = "|"


def environment(home: Path) -> dict[str, str]:
    """An environment without the user's preferences."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("WIRESHARK")}
    return {**kept, "HOME": str(home), "XDG_CONFIG_HOME": str(home / ".config"), "TZ": "UTC"}


def tshark(path: Path, *words: str) -> str:
    """What `tshark -r path ...` prints."""
    done = subprocess.run(
        [need_program("tshark"), "-r", str(path), *words],
        capture_output=True, text=True, check=False, timeout=TIMEOUT_S,
        env=environment(path.parent),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def fields(path: Path, names: Sequence[str], *words: str) -> list[dict[str, str]]:
    """The fields of every packet; several values of one are joined by commas."""
    chosen = [word for name in names for word in ("-e", name)]
    text = tshark(path, "-T", "fields", "-E", f"separator={SEPARATOR}", *chosen, *words)
    return [dict(zip(names, line.split(SEPARATOR), strict=True)) for line in text.splitlines()]
