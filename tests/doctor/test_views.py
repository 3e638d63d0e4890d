"""The same traffic recorded by a tap, by a mirror port and by the programs of both sides.

What does not need times is diagnosed from all of them; what does, from those with a clock.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.doctor.cases import make
from tests.doctor.examine import diagnose, subject_fits, written

SEED = 2
TIMELESS = (
    "address_off_by_one",
    "block_too_long",
    "dead_unit_cost",
    "device_absent",
    "device_busy",
    "register_hole",
    "unexpected_writer",
    "value_spike",
    "wrong_function",
)
VIEWS = (
    "tap.jsonl",
    "gateway.pcap",
    "client, milliseconds.log",
    "client, no clock.log",
    "server, seconds.log",
)
ON_TCP = {"dead_unit_cost": "gateway_unit_id"}
"""Behind a gateway, a unit that never answers may be a number that the gateway does not know."""


@pytest.mark.parametrize("kind", TIMELESS)
def test_all_views_give_the_same_diagnosis(kind: str, tmp_path: Path) -> None:
    """A quantity that a device drops in silence is as well seen in a log without a clock."""
    case = make(kind, SEED)
    assert case.expected is not None
    written(replace(case, files={**case.files, **case.views()}), tmp_path)
    for view in VIEWS:
        rows = diagnose(view, case.words if view == case.main else (), tmp_path)
        assert rows, view
        code = ON_TCP.get(kind, kind) if view == "gateway.pcap" else kind
        expected = replace(case.expected, code=code)
        assert subject_fits(rows[0], expected), (view, [row["sentence"] for row in rows])


@pytest.mark.parametrize("kind", ["slow_answers"])
def test_what_needs_times_is_seen_by_those_who_have_a_clock(kind: str, tmp_path: Path) -> None:
    case = make(kind, SEED)
    assert case.expected is not None
    written(replace(case, files={**case.files, **case.views()}), tmp_path)
    for view in ("tap.jsonl", "gateway.pcap", "client, milliseconds.log"):
        rows = diagnose(view, case.words if view == case.main else (), tmp_path)
        assert any(subject_fits(row, case.expected) for row in rows[:3]), (view, rows)
