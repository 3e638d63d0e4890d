"""The view of health: what is wrong, then utilization, poll cycle, margins, findings."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from analyzer.views import cells, health
from analyzer.views.diagnostics import describe_driver_errors, explain_timeouts, rank_findings
from analyzer.views.live.state import LiveState
from analyzer.views.screen import Part, fit, visible

__all__ = ["lines"]

_HIGH, _CRITICAL = 0.5, 0.8
_BAR_COLUMNS = 20
_ADVICE_AT = 34


def lines(state: LiveState, width: int, height: int) -> list[list[Part]]:
    """What is wrong, the lines of each bus, the margins of the units, the findings."""
    stats = state.statistics
    if not stats.get("buses"):
        return [[("no traffic yet", "dim")]]
    out: list[list[Part]] = []
    judged = state.judgement
    if judged is not None:
        out += [*health.verdict(judged, width), *health.brief(judged, width), []]
    for bus in stats["buses"]:
        out += _bus(bus, state, width)
    if judged is not None:
        out += health.reserves(judged, width)
    findings = list(rank_findings(stats, judged))
    if findings:
        out.append([("findings, most urgent first (modlens explain NAME)", "head")])
    # Where there is room, the advice of the most urgent ones is shown in full.
    spare = height - len(out) - len(findings)
    for finding in findings:
        made = _finding(finding, width, 1 + max(spare, 0))
        spare -= len(made) - 1
        out += made
    return out


def _finding(finding: tuple[str, int, str, str], width: int, most_lines: int) -> list[list[Part]]:
    """A finding with its advice in at most so many lines; the rest is cut off."""
    code, count, severity, advice = finding
    style = {"error": "bad", "warning": "odd"}.get(severity, "note")
    rest = max(width - _ADVICE_AT, 1)
    lines = textwrap.wrap(advice, rest) or [""]
    if len(lines) > most_lines:
        lines = [*lines[: most_lines - 1], " ".join(lines[most_lines - 1 :])]
    head: list[Part] = [(f"{count:9,}  ", ""), (fit(code, _ADVICE_AT - 12), style), (" ", "")]
    first = [*head, (fit(lines[0], rest), "dim")]
    return [first, *([(" " * _ADVICE_AT, ""), (fit(line, rest), "dim")] for line in lines[1:])]


def _bus(bus: dict[str, Any], state: LiveState, width: int) -> Iterator[list[Part]]:
    """The lines of one bus: utilization, poll cycle, frames, driver errors, timeouts."""
    yield [(fit(f"{visible(bus['bus'])}: {bus['mode'] or 'no frames yet'}", width), "head")]
    frames = bus["frames"]
    damaged = sum(frames.get(verdict, 0) for verdict in ("bad_checksum", "incomplete"))
    damaged -= bus.get("cut", 0)
    yield [*_utilization(bus, state), (f"   poll cycle {_cycle(bus)}", "")]
    total = sum(frames.values())
    yield [
        (f"frames {total:,}   ", ""),
        (f"damaged {damaged:,}   ", "bad" if damaged else ""),
        (f"noise {frames.get('noise', 0):,}   ", "odd" if frames.get("noise") else ""),
        (f"retries {sum(row['retries'] for row in bus['units']):,}", ""),
    ]
    driver = describe_driver_errors(bus)
    if driver:
        yield [(fit(f"  {driver}", width).rstrip(), "bad" if "lost" in driver else "odd")]
    for line in explain_timeouts(bus):
        yield [(fit(f"  {line}", width).rstrip(), "bad" if line.startswith("unit") else "")]


def _utilization(bus: dict[str, Any], state: LiveState) -> list[Part]:
    """The utilization of the last seconds; of the whole time until there are some."""
    lately = state.activity.of(bus["bus"]).utilization
    utilization = bus["utilization"] if lately is None else lately
    if utilization is None:
        return [("bus utilization unknown", "dim")]
    style = "bad" if utilization >= _CRITICAL else "odd" if utilization >= _HIGH else "good"
    full = round(min(utilization, 1.0) * _BAR_COLUMNS)
    return [
        ("bus utilization ", ""),
        ("#" * full + "." * (_BAR_COLUMNS - full), style),
        (f" {utilization:.0%}", style),
    ]


def _cycle(bus: dict[str, Any]) -> str:
    cycle = bus.get("cycle")
    if not cycle:
        return "unknown"
    return f"{cells.milliseconds(cycle['p50_us'])} ms, max {cells.milliseconds(cycle['max_us'])} ms"
