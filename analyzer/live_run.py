"""Live runs: from the reads of ports to batches of rows, until the caller stops.

A tap is named on the command line as `[BUS=]PORT[@SETTINGS]`, or `A+B` for one bus that is tapped
in both directions. A bus is added to the core when its line settings are known.

>>> parse_tap("boiler=/dev/ttyUSB0@9600-8N1")
Tap(bus='boiler', ports=('/dev/ttyUSB0',), line=Line(baud=9600, data_bits=8, parity='N', ...), ...)
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import _modlens
from analyzer.line import Line, parse_line
from analyzer.settings import Settings
from analyzer.sources.port_listener import IDLE_NS, PortListener, TappedPort
from analyzer.sources.serial import Chunk
from analyzer.sources.settings_search import SettingsSearch
from analyzer.turn import Turn
from dissectors.errors import UsageError

__all__ = ["LINES", "BusStatus", "LiveRun", "Tap", "parse_tap"]

WAIT_S = 0.05
"""Seconds without rows after which an empty batch is given, so that sinks can look at the clock."""

WAIT_NS = 50_000_000

BUSY_POLL_S = 0.006
"""Seconds between two reads from the queue of a busy line; each one costs waking up a thread."""

READ_LAG_NS = 30_000_000
"""The core is told a time this far in the past: reads may not have reached the queue yet."""

LINES = ("A", "B")
"""Values of the `line` column for the two directions of a bus with two taps."""

CHECK_NS = 1_000_000_000
"""How often settings that were found by listening are checked."""

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


@dataclass(frozen=True, slots=True)
class BusStatus:
    """What a tap knows of a bus besides its traffic.

    `settings` are its line settings, None where it has none or they are not known yet; `origin` is
    `given`, `found`, or `searching`, and empty where there are none (raw TCP). `lost_s` is since
    when a port has been away.
    """

    bus: str
    settings: str | None
    origin: str
    lost_s: float | None


@dataclass(slots=True)
class _Bus:
    """A bus of the run: the numbers of its ports, and its number in the core.

    `number` is None while the first `search` is still looking for the line settings; `line` are the
    settings that the core knows, `origin` is that of `BusStatus`. `check` watches settings that
    were found.
    """

    tap: Tap
    ports: tuple[int, ...]
    number: int | None = None
    search: SettingsSearch | None = None
    line: Line | None = None
    origin: str = ""
    check: _modlens.LineCheck | None = None


class LiveRun:
    """Listens to ports until the caller stops; the ports are opened at once. Use it in `closing`.

    `notify` gets messages about the ports. Settings that are not given are found by listening; with
    `detect` those that are given, too. A lost port is waited for, unless `reconnect` is False.

    `PortError` if a port cannot be opened, `UsageError` for invalid names.
    """

    def __init__(
        self,
        names: Sequence[str | Tap],
        settings: Settings,
        *,
        notify: Callable[[str], None] = lambda _: None,
        reconnect: bool = True,
        detect: bool = False,
    ) -> None:
        taps = [parse_tap(name) if isinstance(name, str) else name for name in names]
        self._settings = settings
        self._core = settings.core(live=True)
        self._notify = notify
        self._recorder: _modlens.Recorder | None = None
        self._recorded_as: dict[int, int] = {}
        self._awaiting_record: list[_Bus] = []
        self._buses: list[_Bus] = []
        self._awaiting_search: list[_Bus] = []
        self._is_searching = False
        self._lines: list[tuple[_Bus, str | None]] = []
        self._turn = Turn()
        self._closed = False
        self._next_check_ns = 0
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
            takes_settings = self._listener.takes_line_settings(bus.ports[0])
            if (detect or given is None) and takes_settings:
                self._awaiting_search.append(bus)
            else:
                bus.origin = "given" if takes_settings else ""
                self._add_to_core(bus, given)

    @property
    def buses(self) -> tuple[str, ...]:
        """The names of the buses."""
        return tuple(bus.tap.bus for bus in self._buses)

    def record(self, recorder: _modlens.Recorder) -> None:
        """Record all reads from now on, and those that are not decoded yet.

        A bus whose settings are searched is recorded when they are found, with the reads that were
        made with these. At the end of each port comes an empty read with a hole, so that a replay
        of the recording decides the last rows at the same moment.
        """
        with self._turn:
            self._recorder = recorder
            for bus in self._buses:
                if bus.number is not None:
                    self._add_to_recorder(bus)
            self._record_directly()

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
        self._record_directly()
        arrivals = self._listener.feed(self._core, WAIT_S, READ_LAG_NS)
        for number, chunk in arrivals:
            self._process_read(number, chunk)
        now = self._listener.now_ns()
        if now >= self._next_check_ns:
            self._next_check_ns = now + CHECK_NS
            self._check_found_settings()
        if not arrivals and not self._is_searching:
            return 0
        self._advance(now - READ_LAG_NS)
        return now

    def finish(self) -> _modlens.Batch:
        """Stop reading, decode what was read, decide what is still open, and give those rows."""
        for number, chunk in self._listener.drain():
            self._process_read(number, chunk)
        now = self._listener.now_ns()
        for bus in self._buses:
            if bus.search is not None:
                self._give_up_search(bus, bus.search)
        for number, (bus, _) in enumerate(self._lines):
            if bus.number is not None:
                self._feed(number, Chunk(b"", now, hole=True))
        self._core.flush()
        return self._core.conclude()

    def stats(self) -> dict[str, Any]:
        """Statistics so far, with the drivers' error counts, for any thread.

        `analyzer.views.stats` documents the keys.
        """
        with self._turn:
            return self._stats()

    def doctor(self) -> dict[str, Any]:
        """What the doctor says so far, with `diagnoses` among the tables, for any thread.

        `analyzer.views.health` documents the keys.
        """
        with self._turn:
            found: dict[str, Any] = json.loads(self._core.doctor())
        return found

    def document(self) -> dict[str, Any]:
        """Doctor, statistics with the drivers' error counts, and overview, for any thread.

        `analyzer.report.document` completes it.
        """
        with self._turn:
            found: dict[str, Any] = json.loads(self._core.document())
            return {**found, "statistics": self._stats()}

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

    def statuses(self) -> list[BusStatus]:
        """Line settings and lost ports of each bus."""
        with self._turn:
            return [self._status(bus) for bus in self._buses]

    def _status(self, bus: _Bus) -> BusStatus:
        line = self._listener.line(bus.ports[0]) if bus.origin else None
        away = [self._listener.lost_s(port) for port in bus.ports]
        lost = max((seconds for seconds in away if seconds is not None), default=None)
        origin = bus.origin if bus.search is None else "searching"
        return BusStatus(bus.tap.bus, None if line is None else str(line), origin, lost)

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
        bus.origin = "searching"
        for port in bus.ports:
            self._listener.unroute(port)
            self._listener.stop_recording(port)
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

    def _check_found_settings(self) -> None:
        """Begin the search again where settings that were found give nothing but damaged bytes."""
        for bus in self._buses:
            if bus.check is None or bus.search is not None or bus.number is None:
                continue
            damage = bus.check.damage(self._core, bus.number)
            if damage is not None:
                self._notify(
                    f"{bus.tap.bus}: no valid frame in the last {damage} bytes at"
                    f" {self._listener.line(bus.ports[0])}"
                )
                self._begin_search(bus)
                self._is_searching = True

    def _give_up_search(self, bus: _Bus, search: SettingsSearch) -> None:
        """Report a search that found nothing by the end; what was heard is kept and decoded."""
        self._notify(f"{bus.tap.bus}: {search.diagnosis()}")
        bus.search = None
        for line, reads in search.heard():
            self._add_to_core(bus, line)
            for number, chunk in reads:
                self._feed(number, chunk)

    def _process_read(self, number: int, chunk: Chunk) -> None:
        bus, _ = self._lines[number]
        if bus.search is None:
            if chunk.hole and chunk.data:
                # The core has already been told the time up to this read. An empty read with a hole
                # records that, so that a replay gives the same rows.
                self._feed(number, Chunk(b"", chunk.time_ns, (), True, chunk.recorded))
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
            search.line_was_set(self._listener.now_ns())
        if found is not None:
            bus.search = None
            for port in bus.ports:
                self._listener.reset_error_counts(port)
            self._notify(f"{bus.tap.bus}: found {found.evidence}")
            bus.origin, bus.check = "found", _modlens.LineCheck()
            self._add_to_core(bus, found.line, mode=found.mode)
            for number, chunk in found.chunks:
                self._feed(number, chunk)

    def _add_to_core(self, bus: _Bus, line: Line | None, mode: str | None = None) -> None:
        """Add a bus, or the same one with other settings, which a later search has found."""
        if bus.number is None or bus.line != line:
            mode = mode or bus.tap.mode or self._settings.mode
            settings = replace(self._settings, line=line, mode=mode)
            bus.number = settings.add_bus(self._core, bus.tap.bus, clock="utc")
            bus.line = line
            if self._recorder is not None:
                self._add_to_recorder(bus)
        elif self._recorder is not None:
            self._awaiting_record.append(bus)
        for side, port in enumerate(bus.ports, start=len(bus.ports) - 1):
            self._listener.route(port, bus.number, side, self._character_ns(bus))

    def _character_ns(self, bus: _Bus) -> int:
        """The time of a character of a line that may be read less often; 0 where it is recorded."""
        return 0 if bus.line is None or self._recorder is not None else bus.line.character_ns

    def _add_to_recorder(self, bus: _Bus) -> None:
        """Describe the ports of a bus with its settings in the recording."""
        assert self._recorder is not None
        line = None if bus.line is None else str(bus.line)
        for number in bus.ports:
            _, letter = self._lines[number]
            name = bus.tap.ports[number - bus.ports[0]]
            added = self._recorder.add_port(name, bus.tap.bus, letter, line)
            self._recorded_as[number] = added
        self._awaiting_record.append(bus)

    def _record_directly(self) -> None:
        """Let reads go to the recorder by themselves, now that none is in our hands."""
        while self._awaiting_record:
            assert self._recorder is not None
            bus = self._awaiting_record.pop()
            for side, port in enumerate(bus.ports, start=len(bus.ports) - 1):
                assert bus.number is not None
                self._listener.route(port, bus.number, side, self._character_ns(bus))
                self._listener.record(port, self._recorder, self._recorded_as[port])

    def _feed(self, number: int, chunk: Chunk) -> None:
        """Pass a read to the core, and to the recorder unless that has it already."""
        bus, line = self._lines[number]
        if self._recorder is not None and not chunk.recorded:
            self._recorder.write(
                self._recorded_as[number],
                chunk.time_ns,
                chunk.data,
                errors=chunk.errors or None,
                hole=chunk.hole,
            )
        assert bus.number is not None
        self._core.feed(
            bus.number,
            chunk.data,
            chunk.time_ns,
            line=line,
            errors=chunk.errors or None,
            hole=chunk.hole,
        )
