"""What a report shows at its top: the name of the plant or bus, the period, the sources."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import takewhile
from pathlib import PurePath
from typing import Any

from analyzer.counts import count_of
from analyzer.visible import visible

__all__ = ["summary"]

MINUTE_S, HOUR_S, DAY_S = 60, 3600, 86400
MOST_NAMES = 2
"""Buses that are named; of more, the number is shown."""


def summary(
    sources: Sequence[Mapping[str, Any]],
    statistics: Mapping[str, Any],
    overview: Mapping[str, Any],
    title: str | None,
) -> dict[str, str]:
    """Returns `name`, `period` and `sources`, each as text for people."""
    lengths = {bus["bus"]: bus["duration_us"] or 0 for bus in statistics["buses"]}
    return {
        "name": visible(title or _name([one["name"] for one in sources], overview["buses"])),
        "period": _period(overview, lengths),
        "sources": _sources(sources, overview["buses"], lengths),
    }


def percent(share: float) -> str:
    """A share in percent; 0 % and 100 % are shown for none and all only."""
    if share in (0, 1):
        return "100 %" if share else "0 %"
    return f"{min(max(share * 100, 0.1), 99.9):.1f} %"


_PRECISIONS = (
    (HOUR_S, 60, "minutes"),
    (MINUTE_S, 1, "seconds"),
    (0, 0.001, "milliseconds"),
)
"""From which length on times are rounded to so many seconds, and the word of `isoformat` for it."""


def _name(sources: Sequence[str], buses: Sequence[Mapping[str, Any]]) -> str:
    """The names that the recordings give their buses, else what the files' names have in common."""
    named = list(dict.fromkeys(bus["bus"] for bus in buses if bus["bus"] != bus["source"]))
    if named:
        return ", ".join(named) if len(named) <= MOST_NAMES else count_of(len(named), "bus")
    common = _common([_stem(name) for name in sources])
    if common.lower() in _GENERIC:
        return _common([PurePath(name).parent.name for name in sources]) or common
    return common or "Modbus"


_GENERIC = frozenset({"capture", "dump", "log", "modbus", "recording", "session", "tap", "trace"})
"""Names of files that say nothing about the bus: the folder does."""


def _common(names: Sequence[str]) -> str:
    """What names begin with in common, without a number at its end."""
    pairs = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    common = "".join(letters[0] for letters in pairs)
    return common.rstrip("-_. 0123456789") or common


def _stem(name: str) -> str:
    path = PurePath(name)
    return path.name.removesuffix("".join(path.suffixes)) or path.name


def _period(overview: Mapping[str, Any], lengths: Mapping[str, float]) -> str:
    """From when to when, how long, and the time zone: the one place of the page that names it."""
    spans = list(_spans(overview, lengths))
    if spans:
        begin, end = min(start for start, _ in spans), max(end for _, end in spans)
        last = _moment(end, end - begin)
        if last[:10] == _moment(begin, end - begin)[:10]:
            last = last[11:]
        return (
            f"{_moment(begin, end - begin)} to {last} ({duration(end - begin)}). All times are UTC."
        )
    whole = sum(lengths.values()) / 1e6
    return f"{duration(whole)}, without a date." if whole else "Without times."


def _spans(
    overview: Mapping[str, Any], lengths: Mapping[str, float]
) -> Iterator[tuple[float, float]]:
    """First and last second of each bus that has a clock.

    The first bucket with a frame is known to its width. An example says when its recording began.
    """
    begun = {
        row["bus"]: _seconds(row["time"]) - row["elapsed_us"] / 1e6
        for row in overview["examples"]
        if row["time"] is not None and row["elapsed_us"] is not None
    }
    for bus in overview["buses"]:
        line = bus["line"]
        if bus["axis"] == "utc":
            first = next((at for at, count in enumerate(line["frames"]) if count), 0)
            start, step = (line["start"] + first * line["step"]) / 1e6, line["step"] / 1e6
            exact = begun.get(bus["bus"], start)
            start = exact if abs(exact - start) <= step else start
            yield start, start + lengths.get(bus["bus"], 0) / 1e6


def _seconds(time: str) -> float:
    whole, _, fraction = time.removesuffix("Z").partition(".")
    seconds = datetime.fromisoformat(whole).replace(tzinfo=UTC).timestamp()
    return seconds + float(f"0.{fraction or 0}")


def _moment(seconds: float, length: float) -> str:
    """Date and time of day: to the minute, or finer where the recording is short."""
    step, spec = next(one for one in _PRECISIONS if length >= one[0])[1:]
    try:
        found = datetime.fromtimestamp(round(seconds / step) * step, UTC)
    except (ValueError, OverflowError, OSError):
        return f"{seconds:.0f} s after 1970"
    return found.replace(tzinfo=None).isoformat(" ", spec)


def duration(seconds: float) -> str:
    """A duration in its largest unit, and the next one where it says something.

    >>> [duration(s) for s in (0.187, 8.8, 725, 86340, 604800)]
    ['187 ms', '8.8 s', '12 min 5 s', '23 h 59 min', '7 days']
    """
    if seconds < 1:
        return f"{seconds * 1000:.0f} ms"
    if seconds < MINUTE_S:
        return f"{seconds:.1f} s"
    if seconds < HOUR_S:
        return _two(round(seconds), MINUTE_S, "min", "s")
    if seconds < 2 * DAY_S:
        return _two(round(seconds / MINUTE_S), MINUTE_S, "h", "min")
    return _two(round(seconds / HOUR_S), 24, "days", "h")


def _two(value: int, base: int, unit: str, smaller: str) -> str:
    whole, rest = divmod(value, base)
    return f"{whole} {unit}" + (f" {rest} {smaller}" if rest else "")


def _sources(
    sources: Sequence[Mapping[str, Any]],
    buses: Sequence[Mapping[str, Any]],
    lengths: Mapping[str, float],
) -> str:
    """How many recordings, of how many hours, with which line settings, and how well they read."""
    live = bool(sources) and all(one["format"] == "live" for one in sources)
    heard: dict[str, float] = {}
    for bus in buses:
        heard[bus["source"]] = max(heard.get(bus["source"], 0), lengths.get(bus["bus"], 0))
    seconds = sum(heard.values()) / 1e6
    parts = [count_of(len(sources), "live line" if live else "recording")]
    if seconds:
        parts.append(_hours(seconds))
    lines = dict.fromkeys(one["line"] for one in sources if one["line"])
    if 0 < len(lines) <= MOST_NAMES:
        parts.append(", ".join(lines))
    read = [one["bytes_in_frames"] for one in sources if one["bytes_in_frames"] is not None]
    if read:
        parts.append(f"{percent(min(read))} of the bytes are in frames")
    return ", ".join(parts)


def _hours(seconds: float) -> str:
    return f"{seconds / HOUR_S:,.0f} hours" if seconds >= 2 * HOUR_S else duration(seconds)
