"""The document of a recording: what the doctor says, statistics, time series, examples.

`modlens stats --to json` writes it, a report embeds it. docs/stats.schema.json describes it;
`VERSION` grows when a reader of the former one could not read it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import _modlens
from analyzer.report.summary import summary
from analyzer.session import RecordingStatus
from dissectors.describe import Piece, describe, pdu_of
from dissectors.table import function
from dissectors.vocabulary import finding

__all__ = ["FORMAT", "VERSION", "complete"]

FORMAT = "modlens report"
VERSION = 1

MAX_PIECES = 24
"""Blocks of a frame that are shown; a response of 125 registers would be a page by itself."""

MAX_NOTES = 20

_CLOCKS = {
    "none": "no times",
    "relative": "from the start of the recording",
    "time of day": "without a date",
    "local": "local, zone unknown",
    "utc": "UTC",
}


def complete(
    core: Mapping[str, Any],
    statuses: Sequence[RecordingStatus],
    functions: _modlens.Functions | None = None,
    *,
    title: str | None = None,
) -> dict[str, Any]:
    """The document.

    - `core`: doctor, statistics and overview (`Run.document`)
    - `statuses`: what was reported of the recordings, or of the ports of a tap
    - `functions`: the table of functions that decodes the examples
    - `title`: the name of the plant or bus; else one is made of the names of buses or files
    """
    functions = functions or _modlens.Functions()
    statistics, overview = core["statistics"], core["overview"]
    codes = {row["function"] for bus in statistics["buses"] for row in bus["units"]}
    codes |= {row["function"] for row in overview["examples"]}
    overview = {**overview, "buses": [bus for bus in overview["buses"] if bus is not None]}
    sources = [_source(one, statistics, overview) for one in _last_of_each(statuses)]
    return {
        "format": FORMAT,
        "version": VERSION,
        "program": f"modlens {_modlens.__version__}",
        "summary": summary(sources, statistics, overview, title),
        "sources": sources,
        "doctor": core["doctor"],
        "statistics": statistics,
        "overview": {
            **overview,
            "examples": [_annotated(row, functions) for row in overview["examples"]],
        },
        "functions": {str(code): _name(code, functions) for code in sorted(codes)},
        "findings": list(_findings(statistics["findings"])),
    }


def _name(code: int, functions: _modlens.Functions) -> str:
    try:
        return function(code, source=functions).name
    except KeyError:
        return "unknown"


def _findings(counts: Mapping[str, int]) -> Iterator[dict[str, Any]]:
    """The findings that occurred, errors first, then the most frequent."""
    order = ("error", "warning", "info")
    known = [(one, count) for code, count in counts.items() if (one := finding(code))]
    for one, count in sorted(known, key=lambda pair: (order.index(pair[0].severity), -pair[1])):
        yield {
            "code": one.code,
            "severity": one.severity,
            "count": count,
            "title": one.title,
            "advice": one.advice,
        }


def _last_of_each(statuses: Sequence[RecordingStatus]) -> list[RecordingStatus]:
    """The last that was reported of each source: at its end, what was not read is known."""
    return list({one.name: one for one in statuses}.values())


def _source(
    status: RecordingStatus, statistics: Mapping[str, Any], overview: Mapping[str, Any]
) -> dict[str, Any]:
    details = status.details
    buses = [bus for bus in overview["buses"] if bus["source"] == status.name]
    names = {bus["bus"] for bus in buses}
    frames = [bus["bytes"] for bus in statistics["buses"] if bus["bus"] in names]
    total = sum(sum(counts.values()) for counts in frames)
    noise = sum(counts.get("noise", 0) for counts in frames)
    clock = details.get("clock") or "none"
    resolution = details.get("resolution_ns")
    settings = dict.fromkeys(bus["settings"] for bus in buses if bus["settings"])
    return {
        "name": status.name,
        "format": status.format or "not read",
        "reason": "named by --from" if status.forced else status.reason,
        "confidence": status.confidence,
        "clock": _CLOCKS.get(clock, clock),
        "resolution_us": resolution / 1000 if resolution and clock != "none" else None,
        "line": ", ".join(settings) or None,
        "bytes_in_frames": (total - noise) / total if total else None,
        "notes": list(_notes(details))[:MAX_NOTES],
    }


def _notes(details: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """What was left out of a recording, and what was said of it."""
    if details.get("trouble"):
        yield {"what": details["trouble"], "count": None}
    for reason, count in (details.get("dropped") or {}).items():
        yield {"what": reason, "count": count}
    if details.get("unparsed"):
        yield {"what": "lines that could not be parsed", "count": details["unparsed"]}
    for number, text, _ in details.get("unparsed_examples", []):
        yield {"what": f"line {number}: {text}", "count": None}
    for said in details.get("said", []):
        yield {"what": said, "count": None}


def _annotated(row: dict[str, Any], functions: _modlens.Functions) -> dict[str, Any]:
    """An example with the blocks of its frames: bytes and what they mean."""
    request = bytes.fromhex(row["request_hex"] or "")
    answered = pdu_of(request, row["mode"])
    frames = []
    for title, direction in (("request", "request"), ("response", "response")):
        data = bytes.fromhex(row[f"{title}_hex"] or "")
        if data:
            pieces = describe(
                data,
                mode=row["mode"],
                direction="request" if direction == "request" else "response",
                request=answered,
                functions=functions,
            )
            frames.append({"title": title, "pieces": list(_pieces(pieces))})
    return {**row, "frames": frames}


def _pieces(pieces: Sequence[Piece]) -> Iterator[list[Any]]:
    """Offset, bytes, field, value, meaning, whether all is well; the middle of many left out."""
    half = MAX_PIECES // 2
    for number, one in enumerate(pieces):
        if len(pieces) <= MAX_PIECES or number < half or number >= len(pieces) - half:
            yield [one.offset, one.data.hex(" "), one.name, one.value, one.meaning, one.is_valid]
        elif number == half:
            count = len(pieces) - 2 * half
            yield [one.offset, "", f"{count} more fields", "", "", True]
