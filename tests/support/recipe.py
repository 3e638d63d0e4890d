"""What a recording of pymodbus on a pty bus consists of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.support.expected import Mode
from tests.support.pymodbus_buses import BusScenario

__all__ = ["Recipe"]


@dataclass(frozen=True, slots=True)
class Recipe:
    """A recording: what it shows, in words, and the play, made again for each recording."""

    shows: str
    run_scenario: Callable[[], BusScenario]
    line: str = "19200-8E1"
    mode: Mode = "rtu"
    healthy: bool = False
