"""Captures of logic analyzers: exactly the frames that are on the line, however they are tapped."""

from __future__ import annotations

import csv
import gzip
import json
from collections.abc import Iterator
from pathlib import Path

import _modlens
from tests.corpus import score_logic
from tests.corpus.score import Score
from tests.support.rechunk import TAPS, Byte

__all__ = ["score"]

_LINES = {"BUS": None, "TX": "A", "RX": "B"}
"""Channels of the captures -> lines of a tap."""


def score(folder: Path) -> Iterator[Score]:
    """A score for each capture and each kind of tap."""
    for path in sorted(folder.glob("*.frames.jsonl")):
        name = path.name.removesuffix(".frames.jsonl")
        wanted = [json.loads(line) for line in path.read_text().splitlines()]
        with gzip.open(folder / f"{name}.bytes.tsv.gz", "rt") as table:
            stream = sorted(_stream(csv.DictReader(table, delimiter="\t")))
        for tap in TAPS:
            yield _score(f"{name} {tap}", tap, stream, wanted)
    yield from score_logic.score(folder)


def _stream(rows: Iterator[dict[str, str]] | csv.DictReader[str]) -> Iterator[Byte]:
    for row in rows:
        yield (
            round(float(row["start_us"]) * 1000),
            _LINES[row["channel"]] or "",
            int(row["byte"], 16),
        )


def _score(name: str, tap: str, stream: list[Byte], wanted: list[dict[str, str]]) -> Score:
    session = _modlens.Session(_modlens.Functions())
    bus = session.add_bus(name, source=name, clock="none" if tap == "untimed" else "relative")
    for time, line, data in TAPS[tap](stream):
        session.feed(bus, data, time, line=line or None)
    session.flush()
    rows = list(session.take().frames)
    found, wrong = 0, []
    for channel in sorted({frame["channel"] for frame in wanted}):
        got = [(row.hex.hex(), row.direction) for row in rows if row.line == _LINES[channel]]
        on_status = [
            (bytes.fromhex(one["hex"]).hex(), one["direction"])
            for one in wanted
            if one["channel"] == channel
        ]
        found += sum(one in got for one in on_status)
        if got != on_status:
            wrong.append(f"{channel}: {len(got)} frames, {len(on_status)} are there")
    return Score(name, len(wanted), found, tap, tuple(wrong))
