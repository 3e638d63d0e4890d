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
from analyzer.sources.serial import Chunk, Port, lost
from dissectors.errors import PortError

__all__ = ["PAUSE_NS", "Listening", "Tapped"]

Arrival = tuple[int, Chunk]
"""The number of the port, and what came in; no bytes and a hole where the port has ended."""

_Taken = tuple[int, int, bytes | None, list[int], bool]

FIRST_TRY_NS, NEXT_TRY_NS = 200_000_000, 1_000_000_000
PAUSE_NS = 1_500_000_000
CHECK_NS = 1_000_000_000
"""How often clocks and counters are looked at."""

NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Tapped:
    """A port to listen to, and its line settings; None where it has none or they are unknown."""

    port: str
    line: Line | None


@dataclass(slots=True)
class _Place:
    """A port, or the place of one that has gone: then `port` is None."""

    name: str
    line: Line | None
    port: Port | None
    lost_ns: int = 0
    next_try_ns: int = 0
    said: str = ""
    counts: dict[str, int] = field(default_factory=dict)
    damage: dict[str, int] = field(default_factory=dict)


class Listening:
    """Open ports; use it in `closing`. `told` hears in words what happens to them.

    After `pause_ns` without bytes nothing is under way on the line. `PortError` if a port cannot be
    opened in the beginning; later only with `reconnect` False.
    """

    def __init__(  # noqa: PLR0913 - most by keyword
        self,
        ports: Sequence[Tapped],
        told: Callable[[str], None],
        *,
        reconnect: bool = True,
        every: float = 0.0,
        pause_ns: int = PAUSE_NS,
        clock: Clock | None = None,
    ) -> None:
        self.clock = clock or Clock()
        self.reconnects = 0
        self._told = told
        self._reconnect = reconnect
        self._every = every
        self._pause_ns = pause_ns
        self._inbox = Inbox()
        self._dropped = 0
        self._next_check_ns = self._look_ns = 0
        self._places: list[_Place] = []
        try:
            for one in ports:
                place = _Place(one.port, one.line, Port(one.port, one.line))
                self._places.append(place)
                self._begin(len(self._places) - 1)
        except PortError:
            self.close()
            raise

    def take(self, timeout: float) -> list[Arrival]:
        """Wait at most `timeout` seconds for reads.

        `PortError` if a port was lost and is not to be waited for.
        """
        taken = self._inbox.take(timeout, self._every)
        return self._arrivals(taken, monotonic_ns())

    def feed(self, core: Session, timeout: float, lag_ns: int) -> list[Arrival]:
        """As `take`, but the reads of ports with a route go to the core, which is told the time.

        Ends when the core has rows. What it is told is `lag_ns` late, because reads may still be on
        their way. The others' reads come back, and all that needs more than to be fed.
        """
        now, shift = monotonic_ns(), self.clock.shift_ns
        taken = self._inbox.feed(core, shift, now + shift - lag_ns, timeout, self._every)
        if taken or now >= self._look_ns:
            return self._arrivals(taken, now)
        return []

    def route(self, number: int, bus: int, line: int, char_ns: int) -> None:
        """Where `feed` brings the reads of a port: see `_modlens.Inbox.route`."""
        self._inbox.route(number, bus, line, char_ns)

    def _arrivals(self, taken: Sequence[_Taken], now: int) -> list[Arrival]:
        arrivals: list[Arrival] = []
        for number, time_ns, data, errors, hole in taken:
            if data is None:
                self._gone(number, errors[0] if errors else 0)
                arrivals.append((number, Chunk(b"", self.clock.at(time_ns), hole=True)))
            else:
                arrivals.append((number, Chunk(data, self.clock.at(time_ns), errors, hole)))
        if now >= self._look_ns:
            self._look_after(now)
        return arrivals

    def tune(self, number: int, line: Line) -> None:
        """Other settings for a port; they hold when it comes back, too."""
        place = self._places[number]
        place.line = line
        if place.port is not None:
            place.port.tune(line)

    def tunable(self, number: int) -> bool:
        """Whether a port takes line settings."""
        port = self._places[number].port
        return port is not None and port.tunable

    def line(self, number: int) -> Line | None:
        """The settings that a port has now."""
        return self._places[number].line

    def marks(self, number: int) -> bool:
        """Whether a port's driver marks line errors."""
        port = self._places[number].port
        return port is not None and port.driver.marked

    def damage(self, number: int) -> dict[str, int]:
        """What the driver has counted since the beginning; empty where it counts nothing."""
        return dict(self._places[number].damage)

    def begin_damage(self, number: int) -> None:
        """What was counted until now came of wrong settings."""
        place = self._places[number]
        if place.port is not None:
            place.counts = dict(place.port.counters())
        place.damage.clear()

    def close(self) -> None:
        """End the readers and close the ports."""
        self._inbox.close()
        for place in self._places:
            if place.port is not None:
                place.port.close()

    def _begin(self, number: int) -> None:
        place = self._places[number]
        assert place.port is not None
        place.counts = dict(place.port.counters())
        if place.port.driver.advice and place.port.driver.advice != place.said:
            place.said = place.port.driver.advice
            self._told(f"{place.name}: {place.said}")
        place.port.listen(self._inbox, number)

    def _gone(self, number: int, code: int) -> None:
        place = self._places[number]
        error = lost(place.name, code)
        if place.port is not None:
            self._inbox.end(number)
            place.port.close()
        if not self._reconnect:
            raise error
        place.port = None
        place.lost_ns = monotonic_ns()
        place.next_try_ns = self._look_ns = place.lost_ns + FIRST_TRY_NS
        self._told(f"{error.message}; waiting for it to come back")

    def _look_after(self, now: int) -> None:
        for number, place in enumerate(self._places):
            if place.port is None and now >= place.next_try_ns:
                self._try_again(number)
        away = any(place.port is None for place in self._places)
        self._look_ns = now + (FIRST_TRY_NS if away else CHECK_NS)
        if now >= self._next_check_ns:
            self._next_check_ns = now + CHECK_NS
            self._check()

    def _try_again(self, number: int) -> None:
        place = self._places[number]
        try:
            place.port = Port(place.name, place.line)
        except PortError as error:
            place.next_try_ns = monotonic_ns() + NEXT_TRY_NS
            if error.message != place.said:
                place.said = error.message
                self._told(f"{error.message}; still waiting")
            return
        self._inbox.hole(number)
        self.reconnects += 1
        away = (monotonic_ns() - place.lost_ns) / NS_PER_S
        self._told(f"{place.name}: back after {away:.1f} s; what was on the line meanwhile is lost")
        self._begin(number)

    def _check(self) -> None:
        self._look_at_clocks()
        dropped = self._inbox.lost()
        if dropped > self._dropped:
            self._told(f"{dropped - self._dropped:,} bytes lost: more waited than memory allows")
            self._dropped = dropped
        for number, place in enumerate(self._places):
            if place.port is not None:
                self._compare(number, place, dict(place.port.counters()))

    def _look_at_clocks(self) -> None:
        change = self.clock.check()
        if change.slept_ns:
            self._told(
                f"the machine slept for {change.slept_ns / NS_PER_S:.1f} s;"
                " what was on the line meanwhile is lost"
            )
            for number in range(len(self._places)):
                self._inbox.hole(number)
        if change.step_ns > 0:
            follows = "; times follow at a pause of the line" if self.clock.is_late else ""
            self._told(f"the clock was set forward by {change.step_ns / NS_PER_S:.1f} s{follows}")
        elif change.step_ns < 0:
            back = -change.step_ns / NS_PER_S
            self._told(f"the clock was set back by {back:.1f} s; times go on without a step")
        if self.clock.is_late and monotonic_ns() - self._inbox.newest() > self._pause_ns:
            self.clock.follow()

    def _compare(self, number: int, place: _Place, counts: dict[str, int]) -> None:
        """Driver's counters run on; what they gained since the last look belongs to this tap."""
        for name, count in counts.items():
            more = count - place.counts.get(name, count)
            if more <= 0:
                continue
            place.damage[name] = place.damage.get(name, 0) + more
            if "overrun" in name:
                self._inbox.hole(number)
                self._told(f"{place.name}: the driver lost bytes {more} times (overrun)")
        place.counts = counts
