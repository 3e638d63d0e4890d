"""The line's timing with invented times: no port, no clock."""

from __future__ import annotations

import pytest

from tests.support.line import HalfDuplexLine, Transmission

CHAR_NS = 1_000
EVERYBODY = {"master": ("unit", "tap"), "unit": ("master", "tap"), "tap": ("master", "unit")}


def sent(sender: str, data: bytes, at_ns: int) -> Transmission:
    """Return an undisturbed transmission."""
    return Transmission(sender, data, data, at_ns)


def test_characters_come_one_by_one_to_all_who_hear() -> None:
    """A character is delivered when its last stop bit has ended, not before."""
    line = HalfDuplexLine(EVERYBODY, CHAR_NS)
    line.submit(sent("master", b"ab", 500))
    assert line.next_due_ns() == 1_500
    assert line.advance(1_499) == []
    assert line.advance(1_500) == [("unit", b"a"), ("tap", b"a")]
    assert line.advance(2_499) == []
    assert not line.idle
    assert line.advance(2_500) == [("unit", b"b"), ("tap", b"b")]
    assert line.idle
    assert line.next_due_ns() is None


def test_who_looks_late_gets_everything_at_once() -> None:
    """Bytes do not depend on how often `advance` is called."""
    line = HalfDuplexLine(EVERYBODY, CHAR_NS)
    line.submit(sent("master", b"abc", 0))
    line.submit(sent("unit", b"de", 0))
    assert dict(line.advance(1_000_000)) == {"unit": b"abc", "tap": b"abcde", "master": b"de"}
    assert [done.sender for done in line.take_finished()] == ["master", "unit"]
    assert line.take_finished() == []


def test_a_fifo_waits_for_its_trigger_or_for_four_silent_characters() -> None:
    """A 16550 UART with trigger level 8 delivers at its trigger or after four silent characters."""
    line = HalfDuplexLine(EVERYBODY, CHAR_NS, trigger=8)
    line.submit(sent("master", b"0123456789", 0))
    assert line.advance(7_999) == []
    assert line.advance(8_000) == [("unit", b"01234567"), ("tap", b"01234567")]
    assert line.advance(13_999) == []
    assert line.next_due_ns() == 14_000
    assert line.advance(14_000) == [("unit", b"89"), ("tap", b"89")]


@pytest.mark.parametrize(("sender", "start_ns"), [("master", 2_000), ("unit", 5_500)])
def test_only_another_sender_keeps_the_turnaround(sender: str, start_ns: int) -> None:
    """A sender's own next bytes follow without a gap."""
    line = HalfDuplexLine(EVERYBODY, CHAR_NS, turnaround_ns=3_500)
    line.submit(sent("master", b"ab", 0))
    line.submit(sent(sender, b"c", 100))
    line.advance(1_000_000)
    first, second = line.take_finished()
    assert (first.start_ns, first.end_ns) == (0, 2_000)
    assert (second.start_ns, second.end_ns) == (start_ns, start_ns + CHAR_NS)


def test_noise_keeps_no_turnaround_and_is_received_by_all() -> None:
    """Noise starts when the line is free and does not count as a sender."""
    line = HalfDuplexLine({"master": ("unit",), "unit": ()}, CHAR_NS, turnaround_ns=3_500)
    line.submit(sent("unit", b"a", 0))
    line.submit(Transmission("noise", b"n", b"n", 0, turnaround=False))
    line.submit(sent("unit", b"b", 0))
    assert line.advance(1_000_000) == [("master", b"n"), ("unit", b"n")]
    assert [done.start_ns for done in line.take_finished()] == [0, 1_000, 2_000]


def test_what_was_lost_takes_no_time() -> None:
    """An answer of which nothing reaches the line neither occupies it nor turns it around."""
    line = HalfDuplexLine(EVERYBODY, CHAR_NS, turnaround_ns=3_500)
    line.submit(sent("master", b"a", 0))
    line.submit(Transmission("unit", b"lost", b"", 1_200))
    line.submit(sent("master", b"b", 2_000))
    line.advance(1_000_000)
    assert [done.start_ns for done in line.take_finished()] == [0, 4_500, 2_000]


@pytest.mark.parametrize(("char_ns", "trigger"), [(0, 1), (1, 0), (1, 15)])
def test_settings_without_sense_are_refused(char_ns: int, trigger: int) -> None:
    """A character takes time; a 16550 has trigger levels up to 14."""
    with pytest.raises(ValueError, match="must be"):
        HalfDuplexLine(EVERYBODY, char_ns, trigger)
