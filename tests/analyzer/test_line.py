"""Line settings as people write them."""

from __future__ import annotations

import pytest

from analyzer import UsageError
from analyzer.line import Line, parse_line


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("19200-8E1", Line(19200, 8, "E", 1)),
        ("9600,8,N,1", Line(9600, 8, "N", 1)),
        ("9600/7o2", Line(9600, 7, "O", 2)),
        (" 115200 8N1.5 ", Line(115200, 8, "N", 1.5)),
        ("300-5M2", Line(300, 5, "M", 2)),
    ],
)
def test_settings_in_one_word(text: str, line: Line) -> None:
    """Any separator will do; the plainest spelling comes back."""
    assert parse_line(text) == line
    assert parse_line(str(line)) == line


@pytest.mark.parametrize(
    "text",
    ["", "19200", "8E1", "19200-9E1", "19200-8X1", "19200-8E3", "x19200-8E1", "49-8E1", "0-8N1"],
)
def test_settings_that_cannot_be(text: str) -> None:
    """One line that says how to write them, or what is out of range."""
    with pytest.raises(UsageError):
        parse_line(text)


def test_a_character_has_a_start_bit_and_a_parity_bit() -> None:
    """A character of 8E1 has 11 bits, one of 8N1 has 10."""
    assert Line(19200).character_ns == 11 * 10**9 // 19200
    assert Line(19200, parity="N").character_ns == 10 * 10**9 // 19200
