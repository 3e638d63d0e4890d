"""Wall time for what the monotonic clock has timed."""

from __future__ import annotations

import time

import pytest

from analyzer.sources.clock import Clock, ClockChange, monotonic_ns, suspended_ns

S = 10**9


class Machine:
    """Three clocks in a test's hand: seconds on the wall, since the start, asleep since then."""

    def __init__(self) -> None:
        """It has run for five seconds."""
        self.wall, self.steady, self.suspended = 1_000 * S, 5 * S, 0
        self.clock = Clock(lambda: self.wall, lambda: self.steady, lambda: self.suspended)

    def go_on(self, seconds: float) -> None:
        """Time passes on all of them."""
        self.wall += round(seconds * S)
        self.steady += round(seconds * S)

    def sleep(self, seconds: float) -> None:
        """The monotonic clock stands still."""
        self.wall += round(seconds * S)
        self.suspended += round(seconds * S)


def test_a_correction_does_not_show() -> None:
    """Less than a second, forward or back: times go on as they did."""
    machine = Machine()
    for correction in (0.4, -0.9, 0.99):
        machine.go_on(1)
        machine.wall += round(correction * S)
        before = machine.clock.now_ns()
        assert machine.clock.check() == ClockChange()
        machine.clock.catch_up()
        machine.go_on(1)
        assert machine.clock.now_ns() >= before + S


def test_a_clock_that_is_set_forward_is_followed_when_somebody_says_so() -> None:
    """The step is reported once; until a pause, transactions in progress keep their times."""
    machine = Machine()
    machine.wall += 3600 * S
    assert machine.clock.check() == ClockChange(step_ns=3600 * S)
    assert machine.clock.is_behind_wall_clock
    machine.go_on(10)
    assert machine.clock.check() == ClockChange()
    assert machine.clock.now_ns() == 1_010 * S
    machine.clock.catch_up()
    assert machine.clock.now_ns() == machine.wall == 4_610 * S
    assert not machine.clock.is_behind_wall_clock
    assert machine.clock.check() == ClockChange()


def test_a_clock_that_is_set_back_is_not_followed() -> None:
    """The step is reported once; when the clock is right again, times do not jump."""
    machine = Machine()
    machine.wall -= 3600 * S
    assert machine.clock.check() == ClockChange(step_ns=-3600 * S)
    machine.go_on(1)
    assert machine.clock.check() == ClockChange()
    machine.clock.catch_up()
    assert machine.clock.now_ns() == 1_001 * S
    machine.wall += 3600 * S
    assert machine.clock.check() == ClockChange(step_ns=3600 * S)
    assert machine.clock.now_ns() == 1_001 * S
    assert machine.clock.at(0) == 1_001 * S - machine.steady


@pytest.mark.parametrize("nap", [0.2, 3600])
def test_a_sleep_is_no_step_of_the_clock(nap: float) -> None:
    """The wall clock is ahead by as much; it is followed at once, because nothing is under way."""
    machine = Machine()
    machine.go_on(7)
    machine.sleep(nap)
    machine.go_on(1)
    assert machine.clock.check() == ClockChange(suspended_ns=round(nap * S))
    assert machine.clock.now_ns() == machine.wall
    assert machine.clock.check() == ClockChange()


def test_a_clock_may_be_set_in_the_sleep() -> None:
    """A suspension followed by a correction of the clock (NTP): both are reported."""
    machine = Machine()
    machine.sleep(100)
    machine.wall += 50 * S
    assert machine.clock.check() == ClockChange(step_ns=50 * S, suspended_ns=100 * S)
    assert machine.clock.now_ns() == machine.wall
    machine.sleep(100)
    machine.wall -= 50 * S
    assert machine.clock.check() == ClockChange(step_ns=-50 * S, suspended_ns=100 * S)
    assert machine.clock.check() == ClockChange()


def test_this_machine_is_awake() -> None:
    """What it has slept does not change while it runs."""
    before = suspended_ns()
    time.sleep(0.05)
    assert abs(suspended_ns() - before) < S // 100
    assert Clock().now_ns() == pytest.approx(time.time_ns(), abs=S)
    assert monotonic_ns() == pytest.approx(time.monotonic_ns(), abs=S)
