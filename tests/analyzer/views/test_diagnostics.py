"""Timeouts explained, and findings in the order in which to look at them; traffic made by hand."""

from __future__ import annotations

import json
from typing import Any

import _modlens
from analyzer.views.diagnostics import explain_timeouts, rank_findings
from dissectors.vocabulary import findings

MS = 1_000_000
SOUND = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")


def framed(body: str) -> bytes:
    """With its checksum."""
    data = bytes.fromhex(body)
    return data + _modlens.crc16(data).to_bytes(2, "little")


def timeouts(*script: tuple[int, bytes]) -> dict[str, Any]:
    """The bus's statistics after bytes at these milliseconds."""
    core = _modlens.Session(_modlens.Functions(), live=True)
    bus = core.add_bus("bus", source="bus", mode="rtu", clock="utc", line=(19200, 8, "E", 1.0))
    for at, data in script:
        core.poll(at * MS)
        core.feed(bus, data, 10**18 + at * MS)
    core.flush()
    found: dict[str, Any] = json.loads(core.stats())["buses"][0]
    return found


def warm(start: int) -> list[tuple[int, bytes]]:
    """Ten sound transactions, so that the line is known; 100 ms each."""
    return [(start + 100 * turn + 20 * half, SOUND[half]) for turn in range(10) for half in (0, 1)]


def test_who_did_not_answer_and_how_long_the_master_waits() -> None:
    """Unit 2 is asked three times for registers 16-19, and never answers; 300 ms each."""
    ask = framed("020300100004")
    script = [*warm(0), (1000, ask), (1305, ask), (1610, ask), *warm(1915)]
    bus = timeouts(*script)
    (row,) = bus["timeouts"]["requests"]
    assert (row["unit"], row["function"], row["address"], row["quantity"]) == (2, 3, 16, 4)
    assert (row["count"], row["asked"], row["late"]) == (3, 3, 0)
    assert 290_000 < bus["timeouts"]["waited"]["p50_us"] < 310_000
    assert row["before"][0] == {"unit": 2, "status": "no_response", "count": 2}
    assert row["before"][1] == {"unit": 1, "status": "ok", "count": 1}
    text = list(explain_timeouts(bus))
    (first, *_) = explain_timeouts(bus, has_two_masters=True)
    assert first.startswith("the response timeout is unknown: two masters end each other's waits")
    assert text[0].startswith("the master's response timeout: ")
    assert text[1].startswith(
        "unit 2, function 3 Read Holding Registers, hr 16-19: no response to 3 of 3 requests"
    )


def test_damage_during_the_wait_is_reported() -> None:
    """Bytes that are no answer came while the master waited."""
    ask = framed("020300100004")
    bus = timeouts(
        *warm(0), (1000, ask), (1050, b"\x55\xaa\x13"), (1305, SOUND[0]), (1325, SOUND[1])
    )
    (row,) = bus["timeouts"]["requests"]
    assert (row["count"], row["damaged"]) == (1, 1)


def test_a_late_answer_is_counted_with_its_delay() -> None:
    """The answer came 50 ms after the master had asked another unit."""
    ask, answer = framed("020300100001"), framed("0203021234")
    script = [
        *warm(0),
        (1000, ask),
        (1020, answer),
        (1100, ask),
        (1305, SOUND[0]),
        (1325, SOUND[1]),
    ]
    bus = timeouts(*script, (1345, answer), *warm(1500))
    assert bus["timeouts"] is not None
    (row,) = bus["timeouts"]["requests"]
    assert (row["unit"], row["count"], row["asked"]) == (2, 1, 2)


def test_a_bus_without_time_outs_says_nothing() -> None:
    """Without timeouts nothing is explained; the poll cycle is that of the request."""
    bus = timeouts(*warm(0))
    assert bus["timeouts"] is None
    assert list(explain_timeouts(bus)) == []
    assert 95_000 < bus["cycle"]["p50_us"] < 105_000
    assert bus["cycle"]["requests"] == 1


def test_the_poll_cycle_is_that_of_the_loop() -> None:
    """A loop of 330 ms: four requests each time, others each fifth and each tenth time.

    A unit that is off, asked and asked again each tenth time, changes nothing.
    """
    script: list[tuple[int, bytes]] = []
    for turn in range(60):
        at = 330 * turn
        wanted = [0, 1, 2, 3] + [4, 5] * (turn % 5 == 0) + [6, 7, 8] * (turn % 10 == 0)
        for place, address in enumerate(wanted):
            begun = at + 30 * place
            script += [(begun, framed(f"0103{address:04x}0001")), (begun + 10, SOUND[1])]
        if turn % 10 == 3:
            script += [(at + 150 + 40 * again, framed("020300100004")) for again in range(3)]
    cycle = timeouts(*script)["cycle"]
    assert 320_000 < cycle["p50_us"] < 340_000


def test_findings_are_ranked_by_weight_then_number() -> None:
    """Each with its advice; every documented one has its place."""
    counts = {one.code: number for number, one in enumerate(findings(), 1)}
    found = list(rank_findings({"findings": counts}))
    assert len(found) == len(counts)
    weights = [("error", "warning", "info").index(severity) for _, _, severity, _ in found]
    assert weights == sorted(weights)
    assert all(advice for *_, advice in found)
