"""Line errors and holes cross the border, and stay with their frames."""

from __future__ import annotations

from typing import Any

import pytest

import _modlens

REQUEST, RESPONSE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
MS = 1_000_000


def codes(session: _modlens.Session) -> list[tuple[Any, ...]]:
    """Each frame's bytes with its findings."""
    session.flush()
    return [(row.hex, tuple(row.findings)) for row in session.take().frames]


def live() -> tuple[_modlens.Session, int]:
    """A session with a bus."""
    session = _modlens.Session(_modlens.Functions(), live=True)
    return session, session.add_bus("bus", source="bus", mode="rtu", clock="utc")


def test_a_mark_belongs_to_its_byte() -> None:
    """Two frames in one read: the one with the marked byte says so, and no byte is deleted."""
    session, bus = live()
    session.feed(bus, REQUEST + RESPONSE, 10 * MS, errors=[9])
    assert codes(session) == [(REQUEST, ()), (RESPONSE, ("line_error",))]


def test_a_hole_is_reported_and_excuses_the_unit() -> None:
    """The answer was lost, not missing: `not_observed`, whatever the time."""
    session, bus = live()
    session.feed(bus, REQUEST, 10 * MS)
    session.feed(bus, REQUEST, 5000 * MS, hole=True)
    session.feed(bus, RESPONSE, 5020 * MS)
    session.flush()
    batch = session.take()
    assert [row.status for row in batch.transactions] == ["not_observed", "ok"]
    assert ["lost_bytes" in row.findings for row in batch.frames] == [False, True, False]


def test_a_hole_ends_a_frame() -> None:
    """Two halves of a frame on both sides of a hole are not one frame."""
    session, bus = live()
    session.feed(bus, REQUEST[:4], 10 * MS)
    session.feed(bus, REQUEST[4:] + REQUEST, 11 * MS, hole=True)
    session.flush()
    frames = [(row.hex, row.verdict) for row in session.take().frames]
    assert (REQUEST, "ok") in frames
    assert all(row != (REQUEST, "ok") for row in frames[:1])
    assert b"".join(data for data, _ in frames) == REQUEST * 2


def test_a_descriptor_that_is_not_open_is_reported() -> None:
    """A closed file descriptor raises `OSError`."""
    with pytest.raises(OSError, match="Bad file"):
        _modlens.Inbox().listen(0, 99_999)
