"""Listens to several ports at once, in order of arrival, for days.

The readers (`_modlens.Inbox`) only read and queue; everything else happens in the caller's thread,
which may stall without loss. A lost port is waited for: reads before the loss are kept, and the
first read after it says that bytes are missing (`Chunk.hole`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import monotonic_ns

from _modlens import Inbox, Recorder, Session
from analyzer.line import Line
from analyzer.sources.serial import Chunk, Port, lost_port_error
from dissectors.errors import PortError

__all__ = ["IDLE_NS", "PortListener", "TappedPort"]

Arrival = tuple[int, Chunk]
"""The number of a port and a read from it; no bytes and a hole where the port was lost."""

_QueuedRead = tuple[int, int, bytes | None, list[int], bool, bool]

FIRST_RETRY_NS, RETRY_INTERVAL_NS = 200_000_000, 1_000_000_000
IDLE_NS = 1_500_000_000
CHECK_INTERVAL_NS = 1_000_000_000
"""Interval between two checks of the clocks and of the drivers' error counters."""

NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class TappedPort:
    """A port to listen to, and its line settings.

    None where it has none or they are not known yet.
    """

    port: str
    line: Line | None


@dataclass(slots=True)
class _PortSlot:
    """A port of the listener; `port` is None while it is lost.

    `last_message` is the last message about it, so that none is repeated; `last_counts` are the
    driver's counters at the last check, `error_counts` what they have gained since the beginning.
    """

    name: str
    line: Line | None
    port: Port | None
    lost_ns: int = 0
    next_retry_ns: int = 0
    last_message: str = ""
    last_counts: dict[str, int] = field(default_factory=dict)
    error_counts: dict[str, int] = field(default_factory=dict)


class PortListener:
    """Open ports; use it in `closing`.

    `notify` gets messages about the ports. Reads are waited for in steps of `poll_s` seconds, to
    save wake-ups; 0 wakes at every read. After `idle_ns` without bytes no transaction is in
    progress, so that times may jump where the clock was set. `PortError` if a port cannot be opened
    in the beginning; later only with `reconnect` False.
    """

    def __init__(
        self,
        ports: Sequence[TappedPort],
        notify: Callable[[str], None],
        *,
        reconnect: bool = True,
        poll_s: float = 0.0,
        idle_ns: int = IDLE_NS,
    ) -> None:
        self.reconnects = 0
        self._notify = notify
        self._reconnect = reconnect
        self._poll_s = poll_s
        self._inbox = Inbox()
        self._inbox.set_idle_ns(idle_ns)
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
        """Wait at most `timeout` seconds for reads, and give them.

        `PortError` if a port is lost and `reconnect` is False.
        """
        taken = self._inbox.take(timeout, self._poll_s)
        return self._arrivals(taken, monotonic_ns())

    def feed(self, core: Session, timeout: float, lag_ns: int) -> list[Arrival]:
        """Wait for reads like `take`, but feed those of routed ports to the core directly.

        Returns as soon as the core has rows. The core is told a time `lag_ns` in the past, because
        reads may not have reached the queue yet. The reads of other ports are returned, and those
        that need more than to be fed: holes and ends.
        """
        now = monotonic_ns()
        taken = self._inbox.feed(core, lag_ns, timeout, self._poll_s)
        if taken or now >= self._next_maintenance_ns:
            return self._arrivals(taken, now)
        return []

    def route(self, number: int, bus: int, line: int, char_ns: int) -> None:
        """Let `feed` pass the reads of a port to this bus and side (see `_modlens.Inbox.route`)."""
        self._inbox.route(number, bus, line, char_ns)

    def unroute(self, number: int) -> None:
        """Let `feed` return the reads of a port again."""
        self._inbox.unroute(number)

    def now_ns(self) -> int:
        """The present time (ns since 1970) on the clock of the reads."""
        return self._inbox.now_ns()

    def record(self, number: int, recorder: Recorder, as_port: int) -> None:
        """Record the reads of a port, before anybody sees them (see `_modlens.Inbox.record`)."""
        self._inbox.record(number, recorder, as_port)

    def stop_recording(self, number: int) -> None:
        """End the recording of a port."""
        self._inbox.stop_recording(number)

    def drain(self) -> list[Arrival]:
        """End the readers, and give what they have read."""
        for slot in self._slots:
            if slot.port is not None:
                slot.port.stop()
        self._inbox.close()
        taken = self._inbox.take(0.0)
        return [
            (
                number,
                Chunk(data or b"", time_ns, errors if data else (), hole or not data, recorded),
            )
            for number, time_ns, data, errors, hole, recorded in taken
        ]

    def lost_s(self, number: int) -> float | None:
        """For how long a port has been away, in seconds; None while it is there."""
        slot = self._slots[number]
        return None if slot.port is not None else (monotonic_ns() - slot.lost_ns) / NS_PER_S

    def _arrivals(self, taken: Sequence[_QueuedRead], now: int) -> list[Arrival]:
        arrivals: list[Arrival] = []
        for number, time_ns, data, errors, hole, recorded in taken:
            if data is None:
                self._on_port_lost(number, errors[0] if errors else 0)
                arrivals.append((number, Chunk(b"", time_ns, (), True, recorded)))
            else:
                arrivals.append((number, Chunk(data, time_ns, errors, hole, recorded)))
        if now >= self._next_maintenance_ns:
            self._maintain(now)
        return arrivals

    def set_line(self, number: int, line: Line) -> None:
        """Change the line settings of a port; they are also used when it is opened again."""
        slot = self._slots[number]
        slot.line = line
        if slot.port is not None:
            slot.port.set_line(line)

    def takes_line_settings(self, number: int) -> bool:
        """Whether a port takes line settings: raw TCP does not."""
        port = self._slots[number].port
        return port is not None and port.takes_line_settings

    def line(self, number: int) -> Line | None:
        """The present line settings of a port."""
        return self._slots[number].line

    def marks_errors(self, number: int) -> bool:
        """Whether a port's driver marks line errors."""
        port = self._slots[number].port
        return port is not None and port.driver.marks_errors

    def error_counts(self, number: int) -> dict[str, int]:
        """Line errors that the driver has counted since the beginning.

        Empty where it does not count.
        """
        return dict(self._slots[number].error_counts)

    def reset_error_counts(self, number: int) -> None:
        """Forget the errors counted so far, which were caused by wrong line settings."""
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
        """Close a port that was lost with this `errno`, and wait for it or raise `PortError`."""
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
        self._notify(f"{error.message}; waiting for it to return")

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
        """Try to open a lost port again; the next read has a hole.

        A message is given only where the error differs from the last one.
        """
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
        self._notify(f"{slot.name}: back after {away:.1f} s; traffic in the meantime is lost")
        self._begin(number)

    def _check_clocks_and_counters(self) -> None:
        self._check_clocks()
        dropped = self._inbox.lost()
        if dropped > self._dropped:
            self._notify(f"{dropped - self._dropped:,} bytes lost: the input queue was full")
            self._dropped = dropped
        for number, slot in enumerate(self._slots):
            if slot.port is not None:
                self._count_errors(number, slot, dict(slot.port.counters()))

    def _check_clocks(self) -> None:
        """Report suspensions and steps of the clock, which the inbox has followed or will."""
        for step_ns, suspended_ns, followed_ns, cuts_traffic in self._inbox.check_clocks():
            if suspended_ns:
                self._notify(
                    f"the machine slept for {suspended_ns / NS_PER_S:.1f} s;"
                    " traffic in the meantime is lost"
                )
            if step_ns > 0:
                follows = "" if followed_ns else "; timestamps follow at the next pause on the line"
                self._notify(f"the clock was set forward by {step_ns / NS_PER_S:.1f} s{follows}")
            elif step_ns < 0:
                back = -step_ns / NS_PER_S
                self._notify(
                    f"the clock was set back by {back:.1f} s; timestamps continue without a step"
                )
            if cuts_traffic:
                self._notify(
                    f"timestamps jump by {followed_ns / NS_PER_S:.1f} s in the middle of traffic,"
                    " because the line does not pause"
                )

    def _count_errors(self, number: int, slot: _PortSlot, last_counts: dict[str, int]) -> None:
        """Add what the driver's counters have gained since the last check; an overrun is a hole."""
        for name, count in last_counts.items():
            more = count - slot.last_counts.get(name, count)
            if more <= 0:
                continue
            slot.error_counts[name] = slot.error_counts.get(name, 0) + more
            if "overrun" in name:
                self._inbox.hole(number)
                self._notify(f"{slot.name}: the driver lost bytes {more} times (overrun)")
        slot.last_counts = last_counts
