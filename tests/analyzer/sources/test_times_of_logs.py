"""Times of logs that no single line shows: ticks, and clocks that are set back."""

from __future__ import annotations

import pytest

import modlens

REQUEST = "05 03 00 10 00 01 84 4B"
RESPONSE = "05 03 02 01 2C 49 C9"
# The last byte of its checksum is wrong.
DAMAGED = "05 03 00 10 00 01 84 4A"


def seconds(lines: list[str]) -> list[float | None]:
    """The times of the frames in a log, in seconds since the first one."""
    frames = modlens.decode("\n".join([*lines, ""]).encode()).frames
    return [None if frame.elapsed_us is None else frame.elapsed_us / 1e6 for frame in frames]


@pytest.mark.parametrize(
    "stamps",
    [
        ("I (12345) mb:", "I (12365) mb:"),
        ("[408464]", "[408484]"),
        ("[   12.345678]", "[   12.365678]"),
        ("1763724605250", "1763724605270"),
        ("2026-11-21 12:30:05,250", "2026-11-21 12:30:05,270"),
        ("Nov 21 12:30:05 gw mb[12]: 12:30:05.250", "Nov 21 12:30:05 gw mb[12]: 12:30:05.270"),
    ],
)
def test_stamps_of_loggers_are_times(stamps: tuple[str, str]) -> None:
    """The second frame comes 20 ms after the first one, whatever prints the time."""
    lines = [f"{stamps[0]} tx {REQUEST}", f"{stamps[1]} rx {RESPONSE}"]
    assert seconds(lines) == [0, 0.02]


@pytest.mark.parametrize("words", [("", ""), ("tx ", "rx ")])
@pytest.mark.parametrize("before", [REQUEST, DAMAGED])
def test_a_frame_after_a_step_back_of_the_clock_has_its_own_time(
    words: tuple[str, str], before: str
) -> None:
    """The clock is set back by 65 s while the frame before, which may be damaged, is still open."""
    sent, received = words
    lines = [
        f"12:30:05.250 {sent}{REQUEST}",
        f"12:30:05.270 {received}{RESPONSE}",
        f"12:30:07.000 {sent}{before}",
        f"12:29:02.000 {sent}{REQUEST}",
        f"12:29:02.020 {received}{RESPONSE}",
    ]
    assert seconds(lines) == [0, 0.02, 1.75, -63.25, -63.23]
