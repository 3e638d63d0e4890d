"""Findings by importance, timeouts and driver errors in words.

>>> stats = {"findings": {"retry": 4, "bad_checksum": 2}}
>>> [code for code, *_ in rank_findings(stats)]
['bad_checksum', 'retry']
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from analyzer.addresses import SHORT
from analyzer.counts import count_of
from analyzer.views import cells
from analyzer.views.cells import function_name
from dissectors.vocabulary import diagnosis, findings

__all__ = ["describe_driver_errors", "explain_timeouts", "rank_findings"]

_DRIVER = {
    "overrun": ("overrun", " of the chip (bytes lost)"),
    "buf_overrun": ("overrun", " of the system's buffer (bytes lost)"),
    "dropped": ("byte", " dropped because memory was full (lost)"),
    "frame": ("framing error", ""),
    "parity": ("parity error", ""),
    "brk": ("break", ""),
}
_SEVERITY_ORDER = {"error": 0, "warning": 1, "info": 2}
_MAX_REQUESTS = 8
_MAX_BEFORE = 3


def rank_findings(
    stats: Mapping[str, Any], doctor: Mapping[str, Any] | None = None
) -> Iterator[tuple[str, int, str, str]]:
    """Code, count, severity and advice of each finding, the most urgent first.

    They are ordered by severity, then by count. Where the doctor has found a cause that brings a
    finding forth, the advice points to it: a finding alone does not know its cause.
    """
    causes = _causes(doctor)
    known = {one.code: (one.severity, one.advice) for one in findings()}
    exceptions = {code for bus in stats.get("buses", ()) for code in _exceptions(bus)}
    found = []
    for code, count in stats["findings"].items():
        severity, advice = known.get(code, ("info", ""))
        if len(exceptions) == 1:
            advice = advice.replace("explain exception N", f"explain exception {min(exceptions)}")
        found.append((code, count, severity, causes.get(code, advice)))
    yield from sorted(found, key=lambda one: (_SEVERITY_ORDER[one[2]], -one[1], one[0]))


def _exceptions(bus: Mapping[str, Any]) -> Iterator[str]:
    """The codes of the exceptions that the units of a bus answered with."""
    for row in bus["units"]:
        yield from row["exceptions"]


def _causes(doctor: Mapping[str, Any] | None) -> dict[str, str]:
    """What is said of a finding that a diagnosis explains: the most harmful one that does."""
    causes: dict[str, str] = {}
    for row in doctor["diagnoses"] if doctor else ():
        if row.get("certainty") == "suspected":
            continue  # One or two examples are no cause; the finding's own advice says more.
        known = diagnosis(row["code"])
        where = "" if row["unit"] is None else f" of unit {row['unit']}"
        for code in known.findings if known else ():
            causes.setdefault(
                code, f"Caused by {row['code']}{where}; modlens doctor says what to do."
            )
    return causes


def describe_driver_errors(bus: Mapping[str, Any]) -> str:
    """The error counts of a tapped port's driver in words; empty where it has none.

    >>> describe_driver_errors({"driver": {"overrun": 2, "parity": 1}})
    'the driver counted 2 overruns of the chip (bytes lost), 1 parity error'
    """
    counts = bus.get("driver") or {}
    words = [
        count_of(counts[name], noun) + rest
        for name, (noun, rest) in _DRIVER.items()
        if counts.get(name)
    ]
    return f"the driver counted {', '.join(words)}" if words else ""


def explain_timeouts(bus: Mapping[str, Any], *, has_two_masters: bool = False) -> Iterator[str]:
    """The timeouts of a bus in words: who, how often, how long the master waits, what was before.

    How long it waits is a bound: the time from a request without response to the next request. Of
    two masters, each ends the waits of the other, so none is a timeout.

    `bus` as in views/stats.py; nothing where nothing timed out.
    """
    found = bus.get("timeouts")
    if not found:
        return
    waited = found["waited"]
    if waited:
        span = " to ".join(cells.milliseconds(waited[end]) for end in ("min_us", "max_us"))
        yield (
            f"the response timeout is unknown: two masters end each other's waits (of {span} ms)"
            if has_two_masters
            else "the master's response timeout: about"
            f" {cells.milliseconds(waited['p50_us'])} ms or less (waits of {span} ms)"
        )
    rows = found["requests"]
    for row in rows[:_MAX_REQUESTS]:
        asked = count_of(row["asked"], "request")
        yield f"{_who(row)}: no response to {row['count']:,} of {asked}{_more(row)}"
    if len(rows) > _MAX_REQUESTS:
        yield f"… and {count_of(len(rows) - _MAX_REQUESTS, 'more request')}"


def _who(row: Mapping[str, Any]) -> str:
    text = f"unit {row['unit']}, function {function_name(row).strip()}"
    if row["address"] is None:
        return text
    last = row["address"] + (row["quantity"] or 1) - 1
    where = str(row["address"]) if last == row["address"] else f"{row['address']}-{last}"
    return f"{text}, {SHORT.get(row['register_type'], '')} {where}".replace(",  ", ", ")


def _more(row: Mapping[str, Any]) -> str:
    parts = []
    if row["late"]:
        late = row["late_by"]
        by = f", {cells.milliseconds(late['p50_us'])} ms late" if late else ""
        parts.append(f"{row['late']:,} answered after the timeout{by}")
    if row["damaged"]:
        parts.append(f"{row['damaged']:,} answered by damaged bytes")
    before = [
        f"unit {one['unit']} {one['status']} ({one['count']:,})"
        for one in row["before"][:_MAX_BEFORE]
    ]
    if before:
        parts.append(f"the transaction before: {', '.join(before)}")
    return f" ({'; '.join(parts)})" if parts else ""
