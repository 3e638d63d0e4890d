"""The view of a bus's health: utilization, poll cycle, retries, timeouts, damage, findings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from analyzer.counts import count_of
from analyzer.views import cells
from analyzer.views.diagnostics import describe_driver_errors, explain_timeouts, rank_findings
from analyzer.views.live.state import LiveState
from analyzer.views.screen import Part, fit, visible

__all__ = ["lines"]

_HIGH, _CRITICAL = 0.5, 0.8
_BAR_COLUMNS = 20


def lines(state: LiveState, width: int, height: int) -> list[list[Part]]:
    """The lines of each bus, then the findings, most urgent first."""
    stats = state.statistics
    if not stats.get("buses"):
        return [[("no traffic yet", "dim")]]
    out: list[list[Part]] = []
    for bus in stats["buses"]:
        out += _bus(bus, width)
    findings = list(rank_findings(stats))
    if findings:
        out.append([("findings, most urgent first (modlens explain NAME)", "head")])
    for code, count, severity, advice in findings:
        style = {"error": "bad", "warning": "odd"}.get(severity, "note")
        rest = max(width - 34, 0)
        out.append(
            [(f"{count:9,}  ", ""), (fit(code, 22), style), (fit(f" {advice}", rest), "dim")]
        )
    return out


def _bus(bus: dict[str, Any], width: int) -> Iterator[list[Part]]:
    """The lines of one bus: utilization, poll cycle, frames, driver errors, timeouts."""
    yield [(fit(f"{visible(bus['bus'])}: {bus['mode'] or 'no frames yet'}", width), "head")]
    frames = bus["frames"]
    damaged = sum(frames.get(verdict, 0) for verdict in ("bad_checksum", "incomplete"))
    yield [*_utilization(bus), (f"   poll cycle {_cycle(bus)}", "")]
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


def _utilization(bus: dict[str, Any]) -> list[Part]:
    utilization = bus["utilization"]
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
    times = (
        f"median {cells.milliseconds(cycle['p50_us'])} ms,"
        f" max {cells.milliseconds(cycle['max_us'])}"
    )
    return f"{times} ms ({count_of(cycle['requests'], 'periodic request')})"
