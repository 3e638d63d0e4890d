"""Logic-analyzer sessions: the frames of the expected file, on their lines, at their times."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from tests.corpus.score import Score

__all__ = ["score"]

CLOSE_US = 60
"""Start bits may be seen so much apart: a bit at 19200 baud."""


def score(folder: Path) -> Iterator[Score]:
    """A score for each session of the folder."""
    for path in sorted(folder.glob("*.sr")):
        yield _score(path)


def _score(path: Path) -> Score:
    on_status: list[RecordingStatus] = []
    run = FileRun([str(path)], Settings(), on_status=on_status.append)
    frames = [row for batch in run.batches() for row in batch.frames]
    lines = path.with_name(f"{path.stem}.frames.jsonl").read_text(encoding="utf-8").splitlines()
    expected = [json.loads(line) for line in lines]
    wrong = [text for want in expected if (text := _missing(want, frames))]
    extra = [row for row in frames if not any(_is(row, want) for want in expected)]
    wrong += [
        f"{row.elapsed_us} us: {row.verdict} {row.hex.hex(' ')} is not expected" for row in extra
    ]
    marked = sum("line_error" in row.findings for row in frames)
    notes = "; ".join([*on_status[-1].details["said"], f"{marked} frames with line errors"])
    return Score(path.name, len(expected), len(expected) - len(wrong), notes, tuple(wrong))


def _is(row: Any, want: dict[str, Any]) -> bool:
    apart = abs(row.elapsed_us - want["start_us"])
    return bool(row.hex == bytes.fromhex(want["hex"]) and apart < CLOSE_US)


def _missing(want: dict[str, Any], frames: list[Any]) -> str:
    place = f"{want['start_us']} us: {want['hex']}"
    for row in frames:
        if _is(row, want):
            if (row.verdict == "ok") != want["crc_ok"]:
                return f"{place}: {row.verdict}"
            if want["direction"] not in (row.direction, "unknown"):
                return f"{place}: {row.direction}"
            return ""
    return f"{place}: no such frame"
