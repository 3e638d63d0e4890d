"""The doctor over an archive: a row for each bus and day."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import _modlens
from analyzer.archive.recordings import ArchivedRecording
from analyzer.archive.side_by_side import Position, Progress, side_by_side
from analyzer.bus_days import bus_day
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from dissectors.errors import SourceError

__all__ = ["bus_days"]

_TABLES = ("frames", "transactions")


def bus_days(  # noqa: PLR0913 - all but two by keyword
    recordings: Sequence[ArchivedRecording],
    settings: Settings,
    *,
    read_as: str | None = None,
    threads: int = 1,
    stop: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
    on_status: Callable[[RecordingStatus], None] = lambda _: None,
) -> list[dict[str, Any]]:
    """The rows of `analyzer.bus_days` of an archive, by bus and day.

    The recordings of a bus are counted together, in the order of their names; buses stand side by
    side, `threads` at a time. `on_status` gets the end of each recording, by any thread. After
    `stop()` the rows are those of what was read.
    """
    chosen = replace(settings, tables=_TABLES)

    def examine(bus: ArchivedRecording, position: Position) -> list[dict[str, Any]]:
        days, named = _modlens.Days(), replace(chosen, bus_name=bus.bus)
        for path in bus.paths:
            if stop():
                break
            _observe(path, named, days, read_as, on_status)
            position.done += bus.size // len(bus.paths)
        return [bus_day(day) for day in json.loads(days.rows())]

    found = side_by_side(
        list(_buses(recordings)),
        examine,
        threads=threads,
        stop=stop,
        progress=progress or Position(),
    )
    rows = [row for _, of_bus in found for row in of_bus]
    return sorted(rows, key=lambda row: (row["bus"], row["date"] or ""))


def _buses(recordings: Sequence[ArchivedRecording]) -> Iterator[ArchivedRecording]:
    """The recordings of each bus as if they were one."""
    together: dict[str, list[ArchivedRecording]] = {}
    for one in recordings:
        together.setdefault(one.name if one.bus is None else f"bus {one.bus}", []).append(one)
    for parts in together.values():
        paths = tuple(path for one in parts for path in one.paths)
        yield ArchivedRecording(paths, parts[0].bus, sum(one.size for one in parts))


def _observe(
    path: str,
    settings: Settings,
    days: _modlens.Days,
    read_as: str | None,
    on_status: Callable[[RecordingStatus], None],
) -> None:
    """Count the rows of a file; `on_status` gets one that cannot be read."""
    try:
        run = FileRun(
            [path],
            settings,
            read_as=read_as,
            on_status=lambda status: on_status(status) if status.ended else None,
        )
        for batch in run.batches():
            days.add(batch)
    except SourceError as error:
        reason = error.message.removeprefix(f"{path}: ")
        on_status(RecordingStatus(path, "", 0.0, reason, False, {}, ended=True, unreadable=True))
