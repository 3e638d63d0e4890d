"""What the decoder knows in advance, and how buses with these settings are added to the core."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import _modlens
from dissectors.errors import UsageError

if TYPE_CHECKING:
    from analyzer.line import Line
    from analyzer.profiles import Binding
    from analyzer.sources.saleae import Levels
    from analyzer.sources.sigrok import Samples

__all__ = ["MODES", "Settings"]

MODES = ("auto", "rtu", "ascii", "tcp")

DEFAULT_TABLES = ("frames", "transactions", "findings")


@dataclass(frozen=True, slots=True)
class Settings:
    """What the decoder knows in advance.

    - `line`: the line settings, None where they are not known
    - `mode`: one of `MODES`
    - `timeout_ns`: after which a request is given up; None lets the core learn it
    - `functions`: the table of functions, vendors' rows included
    - `tables`: the tables worth building
    - `silence_ns`: t3.5 and t1.5, if frames end at silences only; None goes by all evidence
    - `profiles`: which units have which device profile
    - `channels`: those of a logic analyzer; `!` before a name says that it idles low
    - `ports`: where a capture is searched for Modbus; None is 502, nothing in it is everywhere
    - `dialects`: the table of text formats, users' rows included; None for the embedded one
    - `zone`: of times without one: from which ns since 1970 on which offset in ns holds
    - `date`: the day of the first time without a date, as 2026-11-21
    - `bus_name`: of buses that would be named after their recording, which is one of several; None
      names them so
    - `select`: which rows are kept and counted (`analyzer.filters.selection`); all by default
    - `overview`: what to collect of what reports draw; the `courses` have neither values of
      registers nor examples nor rows by function
    """

    line: Line | None = None
    mode: str = "auto"
    timeout_ns: int | None = None
    functions: _modlens.Functions = field(default_factory=_modlens.Functions)
    tables: Sequence[str] = DEFAULT_TABLES
    profiles: Sequence[Binding] = ()
    silence_ns: tuple[int, int] | None = None
    ports: Sequence[int] | None = None
    channels: Sequence[str] | None = None
    dialects: _modlens.Dialects | None = None
    zone: Sequence[tuple[int, int]] = ()
    date: str | None = None
    bus_name: str | None = None
    select: Sequence[_modlens.Predicate] = ()
    overview: Literal["none", "series", "all"] = "none"

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise UsageError(f"mode {self.mode!r}; it is one of {', '.join(MODES)}")
        if self.timeout_ns is not None and self.timeout_ns <= 0:
            raise UsageError("the timeout must be longer than 0")

    def core(self, *, live: bool) -> _modlens.Session:
        """A new session of the core with these settings."""
        tables = self.tables
        if "readings" in tables and "transactions" not in tables:
            tables = (*tables, "transactions")
        core = _modlens.Session(
            self.functions,
            live=live,
            timeout_ns=self.timeout_ns,
            tables=tuple(tables),
            bus_name=self.bus_name,
            overview=self.overview,
            select=tuple(self.select) or None,
        )
        for one in self.profiles:
            core.bind(one.profile.core, one.units, bus=one.bus)
        return core

    def add_bus(self, core: _modlens.Session, name: str, *, clock: str) -> int:
        """Add a bus of this name to the core; gives its number."""
        line = None if self.line is None else self.line.settings
        return core.add_bus(
            self.bus_name or name,
            source=name,
            mode=self.mode,
            line=line,
            clock=clock,
            silence_ns=self.silence_ns,
        )

    def add_capture(self, core: _modlens.Session, name: str) -> int:
        """Add a capture of this name to the core; gives its number."""
        line = None if self.line is None else self.line.settings
        return core.add_capture(
            name, ports=self.ports, mode=self.mode, line=line, silence_ns=self.silence_ns
        )

    def add_logic(self, core: _modlens.Session, samples: Samples | Levels) -> int:
        """Add the samples of a logic analyzer to the core; gives their number."""
        names = [name.removeprefix("!") for name in self.channels or ()]
        low = any(name.startswith("!") for name in self.channels or ())
        return core.add_logic(
            samples.name,
            rate=samples.rate,
            unit=samples.unit,
            channels=samples.channels(names) if names else None,
            inverted=True if low else None,
            mode=self.mode,
            line=None if self.line is None else self.line.settings,
        )
