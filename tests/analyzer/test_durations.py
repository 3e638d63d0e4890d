"""Durations as people type them."""

from __future__ import annotations

import pytest

from analyzer.durations import parse_duration
from analyzer.exports.recorder import Rotation, parse_rotation
from dissectors.errors import UsageError


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90s", 90), ("1h30m", 5400), ("1h 30min", 5400), ("1.5h", 5400), ("2d", 172_800),
     ("0.3", 0.3), ("500ms", 0.5), ("250us", 0.00025), (" 1H30M ", 5400),
     ("1m30s", 90), (".5s", 0.5)],
)  # fmt: skip
def test_what_is_meant(text: str, seconds: float) -> None:
    """Parts add up."""
    assert parse_duration(text, "--duration") == round(seconds * 1e9)


@pytest.mark.parametrize(
    "text", ["", "soon", "1h30", "30m1h", "1h1h", "-5s", "5 parsecs", "0", "1e3s", "99999d", "s"]
)
def test_what_is_no_duration(text: str) -> None:
    """The message names the option and an example."""
    with pytest.raises(UsageError, match=r"--duration .*1h30m"):
        parse_duration(text, "--duration")


def test_rotation_takes_them_too() -> None:
    """A time or a size; a bare number is neither."""
    assert parse_rotation("1h30m") == Rotation(seconds=5400)
    assert parse_rotation("64MB") == Rotation(bytes=64_000_000)
    for text in ("10", "64", "1h30", "MB"):
        with pytest.raises(UsageError, match="--rotate"):
            parse_rotation(text)
