"""The tool `overview`: the recordings that can be read, or what one of them holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from analyzer.assistants.answers import Row, page, without_empty
from analyzer.assistants.fence import Fence
from analyzer.assistants.reading import Reading

__all__ = ["answer"]

MAX_FILES = 10_000
"""Files that are looked for; an archive with more is read by day or folder."""


def answer(fence: Fence, arguments: Mapping[str, Any]) -> str:
    """The recordings, or the counts of the one that is named."""
    offset = arguments.get("offset", 0)
    if "file" not in arguments:
        files: list[Row] = [
            ("recordings", {"file": path, "bytes": size})
            for path, size in islice(fence.files(), MAX_FILES)
        ]
        return page({}, files[offset:], offset=offset, total=len(files))
    reading = Reading(fence, arguments)
    for _ in reading.batches("diagnoses"):
        pass
    doctor, statistics = reading.doctor(), reading.stats()
    head = {
        **reading.head,
        "verdict": doctor["verdict"],
        "sentence": doctor["sentence"],
        "transactions": statistics["transactions"],
        "findings": statistics["findings"],
    }
    rows: list[Row] = [("sources", one) for one in reading.sources]
    several = len(statistics["buses"]) > 1
    rows += [row for bus in statistics["buses"] for row in _bus(bus, named=several)]
    return page(without_empty(head), rows[offset:], offset=offset, total=len(rows))


def _bus(bus: Mapping[str, Any], *, named: bool) -> Iterator[Row]:
    """A bus, its units with their functions, and what its master polls, the longest first."""
    name = {"bus": bus["bus"]} if named else {}
    yield "buses", name | _bus_counts(bus)
    for unit in bus["units"]:
        yield "units", without_empty(name | unit | {"response_time": _times(unit["response_time"])})
    for request in bus["polls"]["requests"]:
        interval = _times(request["interval"])
        yield "polls", without_empty(name | request | {"interval": interval}, ("taken_us",))


def _bus_counts(bus: Mapping[str, Any]) -> dict[str, Any]:
    """What was counted of a bus as a whole: frames by verdict, duration, load, the poll cycle."""
    wanted = {key: bus.get(key) for key in ("mode", "duration_us", "utilization")}
    frames = {verdict: count for verdict, count in bus["frames"].items() if count}
    return without_empty(wanted | {"cycle": _times(bus.get("cycle")), "frames": frames})


def _times(found: Mapping[str, Any] | None) -> dict[str, Any]:
    """The figures of a distribution that answers need; `modlens stats --to json` has all."""
    wanted = ("count", "requests", "min_us", "mean_us", "p50_us", "p95_us", "max_us")
    times = {key: (found or {}).get(key) for key in wanted}
    if times["mean_us"] is not None:
        times["mean_us"] = round(times["mean_us"])
    error = (found or {}).get("percentile_error")
    return without_empty(times | {"percentile_error": error or None})
