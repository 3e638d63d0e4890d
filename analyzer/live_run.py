"""Live runs: from the reads of ports to batches of rows, until the caller stops.

A tap is named on the command line as `[BUS=]PORT[@SETTINGS]`, or `A+B` for one bus that is tapped
in both directions. The loop is the core's (`_modlens.LiveRun`), the same as that of `modlens-tap`.

>>> parse_tap("boiler=/dev/ttyUSB0@9600-8N1")
Tap(bus='boiler', ports=('/dev/ttyUSB0',), line=Line(baud=9600, data_bits=8, parity='N', ...), ...)
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import _modlens
from analyzer.line import Line, parse_line
from analyzer.settings import Settings
from analyzer.sources.schemes import open_port, scheme_of
from analyzer.turn import Turn
from dissectors.errors import PortError, UsageError

__all__ = ["LINES", "BusStatus", "LiveRun", "Tap", "parse_tap"]

WAIT_S = 0.05
"""Seconds without rows after which an empty batch is given, so that sinks can look at the clock."""

LINES = ("A", "B")
"""Values of the `line` column for the two directions of a bus with two taps."""

_LiveBus = tuple[
    str, str, Sequence[str], str, tuple[int, int, str, float] | None, tuple[int, int] | None
]

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


class LiveRun:
    """Listens to ports until the caller stops; the ports are opened at once. Use it in `closing`.

    `notify` gets messages about the ports. Settings that are not given are found by listening; with
    `detect` those that are given as well. A lost port is waited for, unless `reconnect` is False.
    `batches` is where decoded rows leave the loop: `analyzer.pump` hands them to all sinks.

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
        for port in (port for tap in taps for port in tap.ports):
            scheme_of(port)
        self._core = settings.core(live=True)
        self._notify = notify
        self._turn = Turn()
        self._closed = False
        self.buses = tuple(tap.bus for tap in taps)
        with _port_errors():
            self._run = _modlens.LiveRun(
                self._core,
                [_bus(tap, settings) for tap in taps],
                open_port,
                reconnect=reconnect,
                detect=detect,
                idle_ns=settings.timeout_ns or 0,
            )

    def record(
        self,
        recorder: _modlens.Recorder | None,
        servers: Sequence[_modlens.Server] = (),
    ) -> None:
        """Record or serve all reads from now on, and those that are not decoded yet.

        A bus whose settings are searched is recorded when they are found, with the reads that were
        made with these. At the end of each port comes an empty read with a hole, so that a replay
        of the recording decides the last rows at the same moment.
        """
        with self._turn:
            self._run.record(recorder, servers)

    def batches(self) -> Iterator[_modlens.Batch]:
        """The rows as they are decided, by reads or by time that has passed; ends when closed."""
        while True:
            with self._turn:
                if self._closed:
                    return
                self._report()
                with _port_errors():
                    self._run.step(self._core, WAIT_S)
                self._report()
                batch = self._core.take()
            yield batch

    def finish(self) -> _modlens.Batch:
        """Stop reading, decode what was read, decide what is still open, and give those rows."""
        self._run.finish(self._core)
        self._report()
        return self._core.conclude()

    def _report(self) -> None:
        for text in self._run.take_messages():
            self._notify(text)

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

    def events(self) -> list[dict[str, Any]]:
        """The events of troubles since the last call; `analyzer.feeds.troubles` describes them."""
        with self._turn:
            return [json.loads(event) for event in self._core.take_events()]

    def document(self) -> dict[str, Any]:
        """Doctor, statistics with the drivers' error counts, and overview, for any thread.

        `analyzer.report.document` completes it.
        """
        with self._turn:
            found: dict[str, Any] = json.loads(self._core.document())
            return {**found, "statistics": self._stats()}

    def _stats(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self._core.stats())
        for _, number, _, _, _, counts in self._run.statuses():
            if number is not None:
                found["buses"][number]["driver"] = counts
        return found

    def statuses(self) -> list[BusStatus]:
        """Line settings and lost ports of each bus."""
        with self._turn:
            return [
                BusStatus(bus, settings, origin, lost_s)
                for bus, _, settings, origin, lost_s, _ in self._run.statuses()
            ]

    def close(self) -> None:
        """Close the ports, from any thread; `batches` ends."""
        with self._turn:
            self._closed = True
            self._run.close()


def _bus(tap: Tap, settings: Settings) -> _LiveBus:
    """A bus as the core takes it."""
    line = tap.line or settings.line
    return (
        settings.bus_name or tap.bus,
        tap.bus,
        tap.ports,
        tap.mode or settings.mode,
        None if line is None else line.settings,
        settings.silence_ns,
    )


@contextmanager
def _port_errors() -> Iterator[None]:
    """Raise what the core reports about a port as `PortError`."""
    try:
        yield
    except OSError as error:
        port, reason = error.args
        raise PortError(reason, port=port) from error
