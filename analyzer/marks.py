"""Marks of a tap: `k` on its screens notes them beside the raw recording, `find` reads them there.

The file is named after the recording, `today.pcapng.marks`, and has a line for each mark: its
number, and its time in nanoseconds since 1970.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dissectors.errors import SourceError

__all__ = ["marks_of", "note_mark"]

SUFFIX = ".marks"


def note_mark(recording: str, number: int, time_ns: int) -> None:
    """Note a mark beside a recording; `OSError` where that is not possible."""
    with Path(recording + SUFFIX).open("a", encoding="utf-8") as file:
        file.write(f"{number} {time_ns}\n")


def marks_of(recordings: Iterable[str]) -> dict[int, int]:
    """The marks beside these recordings: number -> time; of two with one number, the last one."""
    found: dict[int, int] = {}
    for path in (Path(name + SUFFIX) for name in recordings):
        if not path.is_file():
            continue
        for line in path.read_text("utf-8", errors="replace").splitlines():
            number, _, moment = line.partition(" ")
            if not (number.isdecimal() and moment.isdecimal()):
                raise SourceError(f"{path}: not a mark: {line}")
            found[int(number)] = int(moment)
    return found
