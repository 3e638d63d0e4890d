"""The data of the live screen: the last rows, the values of registers, the statistics.

Memory is bounded: only so many rows and different requests are kept. Values are taken from a
transaction only when the screen is refreshed.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import _modlens
from analyzer.live_run import BusStatus
from analyzer.views.live.activity import Activity
from analyzer.views.live.history import History
from analyzer.views.live.marked import Marked
from analyzer.views.live.roles import Roles
from analyzer.views.row_lines import TableOptions

__all__ = ["LiveState", "LiveValue", "UnitAge"]

MAX_REQUESTS = 4096
HIGHLIGHT_S = 2.0
"""How long a changed value is highlighted."""

JUDGE_S = 2.0
"""How often the doctor is asked."""

DEAD_REQUESTS = 3
"""A unit is shown as dead when so many requests in a row were not answered."""

_UNANSWERED = ("no_response", "bad_response")


@dataclass(slots=True)
class LiveValue:
    """A register, a coil or a named value: when it last changed, and when it was last seen.

    Times are those of the state's clock.
    """

    value: Any
    seen: float
    changed: float = float("-inf")

    def is_highlighted(self, now: float) -> bool:
        """Whether it changed so recently that it is highlighted."""
        return now - self.changed < HIGHLIGHT_S


@dataclass(slots=True)
class UnitAge:
    """When a unit last answered, and how many requests it has not answered since."""

    answered: float | None = None
    unanswered: int = 0

    @property
    def is_dead(self) -> bool:
        """Whether it seems to be off."""
        return self.unanswered >= DEAD_REQUESTS


RegisterKey = tuple[str, int, str, int]
"""Bus, unit, type of register, address."""

NamedKey = tuple[str, int, str]
"""Bus, unit, name of a value in its profile."""


@dataclass
class LiveState:
    """Rows and statistics of a tap.

    `stats` returns the statistics so far, `statuses` what is known of the buses besides, `doctor`
    what is wrong, which is asked every two seconds, `trouble` why nothing can be recorded at the
    moment. While `paused`, what is shown stays as it is. `seen` counts the transactions.
    """

    table_options: TableOptions
    stats: Callable[[], dict[str, Any]]
    statuses: Callable[[], Sequence[BusStatus]] = list
    doctor: Callable[[], Mapping[str, Any] | None] = lambda: None
    clock: Callable[[], float] = time.monotonic
    trouble: Callable[[], str | None] = lambda: None
    paused: bool = False
    history: History = field(default_factory=History)
    marked: Marked = field(default_factory=Marked)
    roles: Roles = field(default_factory=Roles)
    seen: int = 0
    started: float = 0.0
    _requests: dict[tuple[Any, ...], tuple[_modlens.Row, bool]] = field(default_factory=dict)
    _values: dict[RegisterKey, LiveValue] = field(default_factory=dict)
    _named: dict[NamedKey, LiveValue] = field(default_factory=dict)
    _units: dict[NamedKey, str] = field(default_factory=dict)
    _ages: dict[tuple[str, int], UnitAge] = field(default_factory=dict)
    _stats: dict[str, Any] = field(default_factory=dict)
    _statuses: Sequence[BusStatus] = ()
    _judgement: Mapping[str, Any] | None = None
    _judged: float = float("-inf")
    _activity: Activity = field(default_factory=Activity)

    def __post_init__(self) -> None:
        self.started = self.clock()

    def put(self, batch: _modlens.Batch) -> None:
        """Add a batch; see `analyzer.pump.Sink`."""
        table = batch.transactions
        if not len(table):
            return
        self.seen += len(table)
        self.history.add(table)
        self.roles.add(batch)
        now = self.clock()
        known = len(self._requests)
        for row in table:
            self._record_age(row, now)
            self._record_request(row)
        if len(self._requests) > known:
            self._record_units(batch)

    def pause(self, *, paused: bool) -> None:
        """Hold what is shown, or go on; decoding goes on in any case."""
        self.paused = paused
        self.history.hold(held=paused)

    def refresh(self) -> None:
        """Update statistics and values, unless paused."""
        if self.paused:
            return
        self._stats = self.stats()
        self._statuses = self.statuses()
        now = self.clock()
        self._activity.update(self._stats, now)
        if self._judgement is None or now - self._judged >= JUDGE_S:
            self._judgement, self._judged = self.doctor(), now
        for key, (row, is_new) in self._requests.items():
            if is_new:
                self._requests[key] = (row, False)
                self._record_values(row, now)

    @property
    def statistics(self) -> dict[str, Any]:
        """The statistics of the last refresh."""
        return self._stats

    @property
    def judgement(self) -> Mapping[str, Any] | None:
        """What the doctor said last; see `analyzer.views.health`."""
        return self._judgement

    @property
    def bus_statuses(self) -> Sequence[BusStatus]:
        """Line settings and lost ports at the last refresh."""
        return self._statuses

    @property
    def activity(self) -> Activity:
        """What each bus has carried lately."""
        return self._activity

    @property
    def elapsed(self) -> float:
        """Seconds since the tap began."""
        return self.clock() - self.started

    def values(self) -> dict[RegisterKey, LiveValue]:
        """Every register and coil that was seen, sorted."""
        return dict(sorted(self._values.items()))

    def raw(self) -> dict[RegisterKey, int]:
        """The last number of every register and coil."""
        return {place: int(value.value) for place, value in self._values.items()}

    def named(self, bus: str, unit: int) -> dict[str, LiveValue]:
        """The named, scaled values of a unit with a profile, in the order they were first seen."""
        found = self._named.items()
        return {name: value for (on, number, name), value in found if (on, number) == (bus, unit)}

    def unit_of_measure(self, bus: str, unit: int, name: str) -> str:
        """The unit of measure of a named value; empty without one."""
        return self._units.get((bus, unit, name), "")

    def age(self, bus: str, unit: int) -> UnitAge:
        """When a unit last answered."""
        return self._ages.get((bus, unit), UnitAge())

    def last(self, bus: str, unit: int, function: int) -> _modlens.Row | None:
        """The last transaction with values of a unit and function; None if there is none."""
        found = None
        for (name, number, code, *_), (row, _) in self._requests.items():
            if (name, number, code) == (bus, unit, function):
                found = row
        return found

    def _record_age(self, row: _modlens.Row, now: float) -> None:
        age = self._ages.setdefault((row.bus, row.unit), UnitAge())
        if row.status in _UNANSWERED:
            age.unanswered += 1
        elif row.response_frame is not None:
            age.answered, age.unanswered = now, 0

    def _record_request(self, row: _modlens.Row) -> None:
        if row.status != "ok" or row.register_type is None:
            return
        key = (row.bus, row.unit, row.function, row.address, row.quantity, row.write_address)
        self._requests.pop(key, None)
        self._requests[key] = (row, True)
        if len(self._requests) > MAX_REQUESTS:
            del self._requests[next(iter(self._requests))]

    def _record_units(self, batch: _modlens.Batch) -> None:
        """The units of measure of what a batch has read for the first time."""
        found = _modlens.RegisterMap()
        found.add(batch)
        for row in json.loads(found.rows()):
            if row["name"] and row["unit_of_measure"]:
                self._units[row["bus"], row["unit"], row["name"]] = row["unit_of_measure"]

    def _record_values(self, row: _modlens.Row, now: float) -> None:
        for first, data in ((row.address, row.data), (row.write_address, row.write_data)):
            if first is None or data is None:
                continue
            for address, value in enumerate(data, first):
                place = (row.bus, row.unit, row.register_type, address)
                _note(self._values, place, value, now)
        for name, value in (row.readings or {}).items():
            _note(self._named, (row.bus, row.unit, name), value, now)


def _note(values: dict[Any, LiveValue], key: Any, value: Any, now: float) -> None:
    """Notes that a value was seen, and whether it has changed."""
    known = values.get(key)
    if known is None:
        values[key] = LiveValue(value, now)
        return
    known.seen = now
    if known.value != value:
        known.value, known.changed = value, now
