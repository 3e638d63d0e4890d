"""Moments in nanoseconds, from text and as text."""

from __future__ import annotations

import pytest

from analyzer.times import format_seconds, parse_ns

NOON = 1697025600 * 10**9


@pytest.mark.parametrize(
    ("text", "nanoseconds"),
    [
        ("2023-10-11T12:00:00Z", NOON),
        ("2023-10-11 12:00", NOON),
        ("2023-10-11T14:00:00+02:00", NOON),
        ("2023-10-11T14:00:00+0200", NOON),
        ("2023-10-11T12:00:00.000000001Z", NOON + 1),
        ("2023-10-11T12:00:00,5Z", NOON + 500_000_000),
        ("1969-12-31T23:59:59Z", -(10**9)),
        ("noon", None),
        ("12:00", None),
        ("2023-13-11", None),
        ("2023-10-11T25:00", None),
    ],
)
def test_iso_text_is_a_moment(text: str, nanoseconds: int | None) -> None:
    """ISO text is parsed to the nanosecond; without a zone it is UTC."""
    assert parse_ns(text) == nanoseconds


def test_elapsed_time_is_in_seconds() -> None:
    """Microseconds are written as seconds."""
    assert format_seconds(1_234_567.8, 3) == "1.235"
