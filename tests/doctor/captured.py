"""The recordings of `captures/`: which are healthy, as they say, and what ails some others."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from tests.conftest import CAPTURES
from tests.doctor.case import Expected

__all__ = ["TROUBLED", "Capture", "captures", "healthy_captures"]

TROUBLED: Mapping[str, Expected] = {
    "pymodbus_address_off_by_one": Expected("address_off_by_one", unit=1, function=3, address=50),
    "pymodbus_block_too_long": Expected("block_too_long", unit=1, function=3),
    "pymodbus_connect_each_time": Expected("connection_churn"),
    "pymodbus_dead_unit": Expected("dead_unit_cost", unit=3),
    "pymodbus_device_absent": Expected("device_absent", unit=2),
    "pymodbus_device_busy": Expected("device_busy", unit=2),
    "pymodbus_full_line": Expected("bus_saturated"),
    "pymodbus_idle_close": Expected("connection_churn"),
    "pymodbus_late_driver": Expected("driver_enable", unit=2),
    "pymodbus_lockstep": Expected("lockstep"),
    "pymodbus_mixed_answers": Expected("gateway_mixup"),
    "pymodbus_one_client_only": Expected("connection_limit"),
    "pymodbus_register_hole": Expected("register_hole", unit=1, function=3),
    "pymodbus_repeated_write": Expected("unexpected_writer", unit=2),
    "pymodbus_slow_unit": Expected("slow_answers", unit=2),
    "pymodbus_stray_bytes": Expected("no_bias"),
    "pymodbus_too_fast": Expected("polled_too_fast", unit=2),
    "pymodbus_two_masters": Expected("two_masters"),
    "pymodbus_two_with_one_address": Expected("duplicate_address", unit=2),
    "pymodbus_value_spikes": Expected("value_spike", unit=2),
    "pymodbus_wrong_function": Expected("wrong_function", unit=1, function=3),
    "pymodbus_wrong_unit_number": Expected("gateway_unit_id", unit=255),
}
"""What is wrong on the lines that were recorded because of it; other captures show many things."""


@dataclass(frozen=True, slots=True)
class Capture:
    """A capture: its name, its file below `captures/`, and the words after the command."""

    name: str
    file: str
    words: tuple[str, ...]
    healthy: bool


def captures() -> Iterator[Capture]:
    """All of them."""
    for folder in sorted(path for path in CAPTURES.iterdir() if path.is_dir()):
        about: dict[str, Any] = tomllib.loads((folder / "about.toml").read_text(encoding="utf-8"))
        words = tuple(about["command"].split()[3:])
        yield Capture(folder.name, f"{folder.name}/{about['file']}", words, about["healthy"])


def healthy_captures() -> list[Capture]:
    """Those on which somebody who looks for trouble should find none."""
    return [capture for capture in captures() if capture.healthy]
