"""Live runs: from the reads of ports to batches of rows, until the caller stops.

A tap is named on the command line as `[BUS=]PORT[@SETTINGS]`, or `A+B` for one bus that is tapped
in both directions. A bus is added to the core when its line settings are known.

>>> parse_tap("boiler=/dev/ttyUSB0@9600-8N1")
Tap(bus='boiler', ports=('/dev/ttyUSB0',), line=Line(baud=9600, data_bits=8, parity='N', ...), ...)
"""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import _modlens
from analyzer.line import Line, parse_line
from analyzer.session import Settings
from analyzer.sources.port_listener import IDLE_NS, PortListener, TappedPort
from analyzer.sources.serial import Chunk
from analyzer.sources.settings_search import SettingsSearch
from dissectors.errors import UsageError

__all__ = ["LINES", "LiveRun", "Tap", "parse_tap"]

WAIT_S = 0.05
"""Seconds without rows after which an empty batch is given, so that sinks can look at the clock."""

WAIT_NS = 50_000_000

BUSY_POLL_S = 0.006
"""Seconds between two reads from the queue of a busy line; each one costs waking up a thread."""

READ_LAG_NS = 30_000_000
"""The core is told a time this far in the past: reads may not have reached the queue yet."""

LINES = ("A", "B")
"""Values of the `line` column for the two directions of a bus with two taps."""

_NAME = re.compile(r"([\w.-]+)=(.+)")
_SETTINGS = re.compile(r"(.+)@(\d+-\d[A-Za-z][\d.]+)")


@dataclass(frozen=True, slots=True)
class Tap:
    """A bus from the command line or a bus file: its name, one or two ports, settings if given.

    `mode` is None where the mode of the whole run applies.
    """

    bus: str
    ports: tuple[str, ...]
    line: Line | None
    mode: str | None = None


def parse_tap(text: str) -> Tap:
    """Parse `[BUS=]PORT[+PORT][@SETTINGS]`; `UsageError` for more than two ports."""
    named, place, line = _NAME.fullmatch(text), text, None
    if named:
        place = named[2]
    settings = _SETTINGS.fullmatch(place)
    if settings:
        place, line = settings[1], parse_line(settings[2])
    ports = tuple(place.split("+"))
    if len(ports) > len(LINES):
        raise UsageError(f"{text}: a bus has at most two lines, A+B")
    return Tap(named[1] if named else place, ports, line)


class Turn:
    """A lock whose waiters get their turn, although the thread that decodes takes it again at once.

    The thread that has it may take it again: what is notified may ask for statistics.
    """

    def __init__(self) -> None:
        self._queue = threading.Lock()
        self._lock = threading.Lock()
        self._owner: int | None = None
        self._depth = 0

    def __enter__(self) -> None:
        if self._owner != threading.get_ident():
            with self._queue:
                self._lock.acquire()
            self._owner = threading.get_ident()
        self._depth += 1

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        if not self._depth:
            self._owner = None
            self._lock.release()


@dataclass(slots=True)
class _Bus:
    """A bus of the run: the numbers of its ports, and its number in the core.

    `number` is None while `search` is still looking for the line settings.
    """

    tap: Tap
    ports: tuple[int, ...]
    number: int | None = None
    search: SettingsSearch | None = None


class LiveRun:
    """Listens to ports until the caller stops; the ports are opened at once. Use it in `closing`.

    `notify` gets messages about the ports. `on_read` gets every read before it is decoded: bus,
    line of a two-line tap, chunk; while settings are searched, only the reads made with the
    settings found in the end. `on_settings` gets each bus and its settings before its first read.
    Settings that are not given are found by listening; with `detect` those that are given, too. A
    lost port is waited for, unless `reconnect` is False.

    `PortError` if a port cannot be opened, `UsageError` for invalid names.
    """

    def __init__(  # noqa: PLR0913 - most by keyword
        self,
        names: Sequence[str | Tap],
        settings: Settings,
        *,
        notify: Callable[[str], None] = lambda _: None,
        on_read: Callable[[str, str | None, Chunk], None] | None = None,
        on_settings: Callable[[Tap, Line | None], None] = lambda _, __: None,
        reconnect: bool = True,
        detect: bool = False,
    ) -> None:
        taps = [parse_tap(name) if isinstance(name, str) else name for name in names]
        self._settings = settings
        self._core = settings.core(live=True)
        self._notify = notify
        self._on_read = on_read
        self._on_settings = on_settings
        self._buses: list[_Bus] = []
        self._awaiting_search: list[_Bus] = []
        self._is_searching = False
        self._lines: list[tuple[_Bus, str | None]] = []
        self._turn = Turn()
        self._closed = False
        tapped: list[TappedPort] = []
        for tap in taps:
            numbers = tuple(range(len(tapped), len(tapped) + len(tap.ports)))
            bus = _Bus(tap, numbers)
            self._buses.append(bus)
            for port, line in zip(tap.ports, LINES, strict=False):
                tapped.append(TappedPort(port, tap.line or settings.line))
                self._lines.append((bus, line if len(tap.ports) > 1 else None))
        self._listener = PortListener(
            tapped,
            notify,
            reconnect=reconnect,
            poll_s=BUSY_POLL_S,
            idle_ns=(settings.timeout_ns or 0) + IDLE_NS,
        )
        for bus in self._buses:
            given = bus.tap.line or settings.line
            if (detect or given is None) and self._listener.takes_line_settings(bus.ports[0]):
                self._awaiting_search.append(bus)
            else:
                self._add_to_core(bus, given)

    @property
    def buses(self) -> tuple[str, ...]:
        """The names of the buses."""
        return tuple(bus.tap.bus for bus in self._buses)

    def batches(self) -> Iterator[_modlens.Batch]:
        """The rows as they are decided, by reads or by time that has passed; ends when closed."""
        self._is_searching = bool(self._awaiting_search)
        while self._awaiting_search:
            self._begin_search(self._awaiting_search.pop(0))
        last_ns = 0
        while True:
            with self._turn:
                if self._closed:
                    return
                now = self._listen()
                if not self._core.pending_rows() and now and now - last_ns < WAIT_NS:
                    continue
                last_ns = now or last_ns
                batch = self._core.take()
            yield batch

    def _listen(self) -> int:
        """Wait for reads and have them decoded; the time, where it was needed, and 0 otherwise."""
        arrivals = self._listener.feed(self._core, WAIT_S, READ_LAG_NS)
        for number, chunk in arrivals:
            self._process_read(number, chunk)
        if not arrivals and not self._is_searching:
            return 0
        now = self._listener.clock.now_ns()
        self._advance(now - READ_LAG_NS)
        return now

    def finish(self) -> _modlens.Batch:
        """Decide what is still open, and give those rows.

        `on_read` gets an empty read with a hole at the end of each port, so that a replay of the
        recording decides the last rows at the same moment.
        """
        now = self._listener.clock.now_ns()
        for number, (bus, _) in enumerate(self._lines):
            if bus.number is not None:
                self._feed(number, Chunk(b"", now, hole=True))
        self._core.flush()
        return self._core.take()

    def stats(self) -> dict[str, Any]:
        """Statistics so far, with the drivers' error counts, for any thread.

        `analyzer.views.stats` documents the keys.
        """
        with self._turn:
            return self._stats()

    def _stats(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self._core.stats())
        for bus in self._buses:
            if bus.number is not None:
                driver: dict[str, int] = {}
                for port in bus.ports:
                    for name, count in self._listener.error_counts(port).items():
                        driver[name] = driver.get(name, 0) + count
                found["buses"][bus.number]["driver"] = driver
        return found

    def close(self) -> None:
        """Close the ports, from any thread; `batches` ends."""
        with self._turn:
            self._closed = True
            self._listener.close()

    def _advance(self, now: int) -> None:
        """Tell the core and the running searches what time it is."""
        for bus in self._buses:
            if bus.search is not None:
                bus.search.advance(now)
                self._follow_search(bus, bus.search)
        self._is_searching = any(bus.search is not None for bus in self._buses)
        self._core.poll(now)

    def _begin_search(self, bus: _Bus) -> None:
        """Begin the search for the line settings of a bus."""
        labels = {} if len(bus.ports) == 1 else dict(zip(bus.ports, LINES, strict=True))
        marks_errors = all(self._listener.marks_errors(port) for port in bus.ports)
        bus.search = SettingsSearch(
            lambda text: self._notify(f"{bus.tap.bus}: {text}"),
            marks_errors=marks_errors,
            labels=labels,
        )
        self._notify(f"{bus.tap.bus}: detecting the line settings; waiting for traffic")
        self._set_line(bus, bus.search.line)

    def _set_line(self, bus: _Bus, line: Line) -> None:
        for port in bus.ports:
            self._listener.set_line(port, line)

    def _process_read(self, number: int, chunk: Chunk) -> None:
        bus, _ = self._lines[number]
        if bus.search is None:
            if chunk.hole and chunk.data:
                # The core has already been told the time up to this read. An empty read with a hole
                # records that, so that a replay gives the same rows.
                self._feed(number, Chunk(b"", chunk.time_ns, hole=True))
            self._feed(number, chunk)
        else:
            bus.search.feed(number, chunk)
            self._follow_search(bus, bus.search)

    def _follow_search(self, bus: _Bus, search: SettingsSearch) -> None:
        """Set the ports to the settings that the search tries next, or finish the search.

        When settings are found, the bus is added to the core and the reads made with them are
        decoded.
        """
        found = search.found
        line = search.line if found is None else found.line
        if line != self._listener.line(bus.ports[0]):
            self._set_line(bus, line)
        if found is not None:
            bus.search = None
            for port in bus.ports:
                self._listener.reset_error_counts(port)
            self._notify(f"{bus.tap.bus}: found {found.evidence}")
            self._add_to_core(bus, found.line, mode=found.mode)
            for number, chunk in found.chunks:
                self._feed(number, chunk)

    def _add_to_core(self, bus: _Bus, line: Line | None, mode: str | None = None) -> None:
        mode = mode or bus.tap.mode or self._settings.mode
        settings = replace(self._settings, line=line, mode=mode)
        bus.number = settings.add_bus(self._core, bus.tap.bus, clock="utc")
        self._on_settings(bus.tap, line)
        # Without a recording the reads need not come to Python: the inbox feeds them to the core.
        if self._on_read is None:
            char_ns = 0 if line is None else line.character_ns
            for side, port in enumerate(bus.ports, start=len(bus.ports) - 1):
                self._listener.route(port, bus.number, side, char_ns)

    def _feed(self, number: int, chunk: Chunk) -> None:
        """Pass a read to `on_read` and then to the core."""
        bus, line = self._lines[number]
        if self._on_read is not None:
            self._on_read(bus.tap.bus, line, chunk)
        assert bus.number is not None
        self._core.feed(
            bus.number,
            chunk.data,
            chunk.time_ns,
            line=line,
            errors=chunk.errors or None,
            hole=chunk.hole,
        )
