"""Logs: every byte string that a file is known to hold is a frame, or is listed as left out.

A string with a right checksum has to be one frame with the verdict `ok`, in its place, with a
direction that agrees with the log's words. Any other string (a block, a printed copy, a wrapper)
has to be in the stream of frames or in the list of what was left out. A log without strings
must give no frame.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from dissectors.errors import SourceError
from tests.corpus.score import Score

__all__ = ["score"]


@dataclass(frozen=True, slots=True)
class Reading:
    """What became of a file: frames with their places in the stream, and what was left out."""

    frames: list[Any]
    left_out: list[tuple[int, str, str]]
    notes: str


def score(folder: Path) -> Iterator[Score]:
    """A score for each log of the folder."""
    for path in sorted(folder.iterdir()):
        if path.suffix != ".jsonl":
            expected = path.with_name(f"{path.name}.expected.jsonl")
            lines = expected.read_text(encoding="utf-8").splitlines() if expected.exists() else []
            yield _score(path, [json.loads(line) for line in lines])


def _read(path: Path) -> Reading:
    on_status: list[RecordingStatus] = []
    run = FileRun([str(path)], Settings(), on_status=on_status.append)
    frames = [row for batch in run.batches() for row in batch.frames]
    last = on_status[-1]
    left_out = [tuple(entry) for entry in last.details.get("left_out", [])]
    return Reading(frames, left_out, f"{last.format}, {last.details.get('clock')} clock")


def _score(path: Path, expected: list[dict[str, Any]]) -> Score:
    try:
        reading = _read(path)
    except SourceError as error:
        if expected:
            return Score(path.name, len(expected), 0, "refused", (str(error),))
        return Score(path.name, 0, 0, f"refused: {str(error).removeprefix(str(path))[:100]}")
    if not expected:
        good = [frame.hex.hex(" ") for frame in reading.frames if frame.verdict == "ok"]
        return Score(path.name, 0, 0, reading.notes, tuple(f"a frame: {text}" for text in good))
    wrong = [*_missing(expected, reading), *_directions(expected, reading)]
    missing = sum(text.startswith("line ") for text in wrong)
    return Score(path.name, len(expected), len(expected) - missing, reading.notes, tuple(wrong))


def _missing(expected: list[dict[str, Any]], reading: Reading) -> Iterator[str]:
    whole = {(_line(frame), frame.hex): frame for frame in reading.frames if frame.verdict == "ok"}
    stream = b"".join(frame.hex for frame in reading.frames)
    gone = {(line, bytes.fromhex(text)) for line, text, _ in reading.left_out}
    at = 0
    for want in expected:
        data = bytes.fromhex(want["hex"])
        place = f"line {want['line']}: {want['kind']} {want['hex'][:60]}"
        if _checked(want):
            if (want["line"], data) not in whole:
                yield f"{place}: no whole frame"
        elif (want["line"], data) not in gone:
            found = stream.find(data, at)
            if found < 0:
                yield f"{place}: neither delivered nor listed"
            else:
                at = found


def _directions(expected: list[dict[str, Any]], reading: Reading) -> Iterator[str]:
    """The log's words and our directions belong together one to one."""
    on_status = {(_line(frame), frame.hex): frame.direction for frame in reading.frames}
    pairs: dict[tuple[str, str], int] = {}
    for want in expected:
        data = bytes.fromhex(want["hex"])
        direction = on_status.get((want["line"], data))
        if not _checked(want) or direction is None:
            continue
        if want["dir"] in ("request", "response") and want["dir"] != direction:
            yield f"direction of line {want['line']}: {direction}, not {want['dir']}"
        if want["dir"] in ("tx", "rx"):
            pairs.setdefault((want["dir"], direction), want["line"])
    for side in ("tx", "rx"):
        if len({direction for said, direction in pairs if said == side}) > 1:
            yield f"direction: {side} is both request and response: {pairs}"


def _checked(want: dict[str, Any]) -> bool:
    """Whether the string is proved by a checksum, or by the length in its MBAP header."""
    return bool(want.get("crc_ok") or want.get("lrc_ok") or want["kind"] == "tcp")


def _line(frame: Any) -> int:
    return int(frame.source.rpartition(":")[2])
