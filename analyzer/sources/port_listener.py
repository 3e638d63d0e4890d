"""Several ports at once, in order of arrival, for days.

The readers (`_modlens.Inbox`) only read and queue; everything else happens on the caller's thread,
which may stall without loss. A port that goes away is waited for: what came before stays, the first
bytes after it say that something is missing (`Chunk.hole`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from _modlens import Inbox, Session
from analyzer.line import Line
from analyzer.sources.clock import Clock, monotonic_ns
from analyzer.sources.serial import Chunk, Port, lost_port_error
from dissectors.errors import PortError

__all__ = ["IDLE_NS", "PortListener", "TappedPort"]

Arrival = tuple[int, Chunk]
"""The number of the port, and what came in; no bytes and a hole where the port has ended."""

_QueuedRead = tuple[int, int, bytes | None, list[int], bool]

FIRST_RETRY_NS, RETRY_INTERVAL_NS = 200_000_000, 1_000_000_000
IDLE_NS = 1_500_000_000
CHECK_INTERVAL_NS = 1_000_000_000
"""How often clocks and counters are looked at."""

NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class TappedPort:
    """A port to listen to, and its line settings; None where it has none or they are unknown."""

    port: str
    line: Line | None


@dataclass(slots=True)
class _PortSlot:
    """A port, or the place of one that has gone: then `port` is None."""

    name: str
    line: Line | None
    port: Port | None
    lost_ns: int = 0
    next_retry_ns: int = 0
    last_message: str = ""
    last_counts: dict[str, int] = field(default_factory=dict)
    error_counts: dict[str, int] = field(default_factory=dict)


class PortListener:
    """Open ports; use it in `closing`. `notify` hears in words what happens to them.

    After `idle_ns` without bytes nothing is under way on the line. `PortError` if a port cannot be
    opened in the beginning; later only with `reconnect` False.
    """

    def __init__(  # noqa: PLR0913 - most by keyword
        self,
        ports: Sequence[TappedPort],
        notify: Callable[[str], None],
        *,
        reconnect: bool = True,
        poll_s: float = 0.0,
        idle_ns: int = IDLE_NS,
        clock: Clock | None = None,
    ) -> None:
        self.clock = clock or Clock()
        self.reconnects = 0
        self._notify = notify
        self._reconnect = reconnect
        self._poll_s = poll_s
        self._idle_ns = idle_ns
        self._inbox = Inbox()
        self._dropped = 0
        self._next_check_ns = self._next_maintenance_ns = 0
        self._slots: list[_PortSlot] = []
        try:
            for one in ports:
                slot = _PortSlot(one.port, one.line, Port(one.port, one.line))
                self._slots.append(slot)
                self._begin(len(self._slots) - 1)
        except PortError:
            self.close()
            raise

    def take(self, timeout: float) -> list[Arrival]:
        """Wait at most `timeout` seconds for reads.

        `PortError` if a port was lost and is not to be waited for.
        """
        taken = self._inbox.take(timeout, self._poll_s)
        return self._arrivals(taken, monotonic_ns())

    def feed(self, core: Session, timeout: float, lag_ns: int) -> list[Arrival]:
        """As `take`, but the reads of ports with a route go to the core, which is told the time.

        Ends when the core has rows. What it is told is `lag_ns` late, because reads may still be on
        their way. The others' reads come back, and all that needs more than to be fed.
        """
        now, shift = monotonic_ns(), self.clock.shift_ns
        taken = self._inbox.feed(core, shift, now + shift - lag_ns, timeout, self._poll_s)
        if taken or now >= self._next_maintenance_ns:
            return self._arrivals(taken, now)
        return []

    def route(self, number: int, bus: int, line: int, char_ns: int) -> None:
        """Where `feed` brings the reads of a port: see `_modlens.Inbox.route`."""
        self._inbox.route(number, bus, line, char_ns)

    def _arrivals(self, taken: Sequence[_QueuedRead], now: int) -> list[Arrival]:
        arrivals: list[Arrival] = []
        for number, time_ns, data, errors, hole in taken:
            if data is None:
                self._on_port_lost(number, errors[0] if errors else 0)
                arrivals.append((number, Chunk(b"", self.clock.at(time_ns), hole=True)))
            else:
                arrivals.append((number, Chunk(data, self.clock.at(time_ns), errors, hole)))
        if now >= self._next_maintenance_ns:
            self._maintain(now)
        return arrivals

    def set_line(self, number: int, line: Line) -> None:
        """Other settings for a port; they hold when it comes back, too."""
        slot = self._slots[number]
        slot.line = line
        if slot.port is not None:
            slot.port.set_line(line)

    def takes_line_settings(self, number: int) -> bool:
        """Whether a port takes line settings."""
        port = self._slots[number].port
        return port is not None and port.takes_line_settings

    def line(self, number: int) -> Line | None:
        """The settings that a port has now."""
        return self._slots[number].line

    def marks_errors(self, number: int) -> bool:
        """Whether a port's driver marks line errors."""
        port = self._slots[number].port
        return port is not None and port.driver.marks_errors

    def error_counts(self, number: int) -> dict[str, int]:
        """What the driver has counted since the beginning; empty where it counts nothing."""
        return dict(self._slots[number].error_counts)

    def reset_error_counts(self, number: int) -> None:
        """What was counted until now came of wrong settings."""
        slot = self._slots[number]
        if slot.port is not None:
            slot.last_counts = dict(slot.port.counters())
        slot.error_counts.clear()

    def close(self) -> None:
        """End the readers and close the ports."""
        self._inbox.close()
        for slot in self._slots:
            if slot.port is not None:
                slot.port.close()

    def _begin(self, number: int) -> None:
        slot = self._slots[number]
        assert slot.port is not None
        slot.last_counts = dict(slot.port.counters())
        if slot.port.driver.advice and slot.port.driver.advice != slot.last_message:
            slot.last_message = slot.port.driver.advice
            self._notify(f"{slot.name}: {slot.last_message}")
        slot.port.listen(self._inbox, number)

    def _on_port_lost(self, number: int, code: int) -> None:
        slot = self._slots[number]
        error = lost_port_error(slot.name, code)
        if slot.port is not None:
            self._inbox.end(number)
            slot.port.close()
        if not self._reconnect:
            raise error
        slot.port = None
        slot.lost_ns = monotonic_ns()
        slot.next_retry_ns = self._next_maintenance_ns = slot.lost_ns + FIRST_RETRY_NS
        self._notify(f"{error.message}; waiting for it to come back")

    def _maintain(self, now: int) -> None:
        for number, slot in enumerate(self._slots):
            if slot.port is None and now >= slot.next_retry_ns:
                self._reopen(number)
        away = any(slot.port is None for slot in self._slots)
        self._next_maintenance_ns = now + (FIRST_RETRY_NS if away else CHECK_INTERVAL_NS)
        if now >= self._next_check_ns:
            self._next_check_ns = now + CHECK_INTERVAL_NS
            self._check_clocks_and_counters()

    def _reopen(self, number: int) -> None:
        slot = self._slots[number]
        try:
            slot.port = Port(slot.name, slot.line)
        except PortError as error:
            slot.next_retry_ns = monotonic_ns() + RETRY_INTERVAL_NS
            if error.message != slot.last_message:
                slot.last_message = error.message
                self._notify(f"{error.message}; still waiting")
            return
        self._inbox.hole(number)
        self.reconnects += 1
        away = (monotonic_ns() - slot.lost_ns) / NS_PER_S
        self._notify(
            f"{slot.name}: back after {away:.1f} s; what was on the line meanwhile is lost"
        )
        self._begin(number)

    def _check_clocks_and_counters(self) -> None:
        self._check_clocks()
        dropped = self._inbox.lost()
        if dropped > self._dropped:
            self._notify(f"{dropped - self._dropped:,} bytes lost: more waited than memory allows")
            self._dropped = dropped
        for number, slot in enumerate(self._slots):
            if slot.port is not None:
                self._count_errors(number, slot, dict(slot.port.counters()))

    def _check_clocks(self) -> None:
        change = self.clock.check()
        if change.suspended_ns:
            self._notify(
                f"the machine slept for {change.suspended_ns / NS_PER_S:.1f} s;"
                " what was on the line meanwhile is lost"
            )
            for number in range(len(self._slots)):
                self._inbox.hole(number)
        if change.step_ns > 0:
            follows = (
                "; times follow at a pause of the line" if self.clock.is_behind_wall_clock else ""
            )
            self._notify(f"the clock was set forward by {change.step_ns / NS_PER_S:.1f} s{follows}")
        elif change.step_ns < 0:
            back = -change.step_ns / NS_PER_S
            self._notify(f"the clock was set back by {back:.1f} s; times go on without a step")
        if (
            self.clock.is_behind_wall_clock
            and monotonic_ns() - self._inbox.newest() > self._idle_ns
        ):
            self.clock.catch_up()

    def _count_errors(self, number: int, slot: _PortSlot, last_counts: dict[str, int]) -> None:
        """Driver's counters run on; what they gained since the last look belongs to this tap."""
        for name, count in last_counts.items():
            more = count - slot.last_counts.get(name, count)
            if more <= 0:
                continue
            slot.error_counts[name] = slot.error_counts.get(name, 0) + more
            if "overrun" in name:
                self._inbox.hole(number)
                self._notify(f"{slot.name}: the driver lost bytes {more} times (overrun)")
        slot.last_counts = last_counts
