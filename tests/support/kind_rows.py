"""The words in which kinds of devices are written: a row for each value, by its role."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Item", "Kind", "bits", "constant", "counted", "measured", "state"]


class Item(NamedTuple):
    """A value of a device."""

    address: int
    type: str
    order: str
    role: str
    scale: float
    unit: str | None
    quantity: str | None
    signal: str


class Kind(NamedTuple):
    """A kind of device: what is read (table, first address, count, seconds between reads)."""

    blocks: tuple[tuple[str, int, int], ...]
    seconds: int
    items: tuple[Item, ...]


_UNITS = {
    "V": "voltage", "A": "current", "W": "active power", "Hz": "frequency", "Wh": "energy",
    "degC": "temperature", "s": "duration", "VA": "apparent power", "kWh": "energy",
    "kW": "active power",
}  # fmt: skip


def measured(  # noqa: PLR0913, PLR0917 - a row of a table
    address: int, kind: str, scale: float, unit: str | None, signal: str, role: str = "measurement"
) -> Item:
    """A measurement, or a value of another `role`; `kind` is the type, a blank, the order."""
    name, _, order = kind.partition(" ")
    return Item(address, name, order or "ABCD", role, scale, unit, _UNITS.get(unit or ""), signal)


def counted(address: int, kind: str, scale: float, unit: str | None, signal: str) -> Item:
    """A counter."""
    return measured(address, kind, scale, unit, signal, "counter")


def constant(address: int, kind: str, scale: float, unit: str | None, signal: str) -> Item:
    """A value that stays."""
    return measured(address, kind, scale, unit, signal, "constant")


def state(address: int, signal: str, kind: str = "u16") -> Item:
    """A number that stands for a state."""
    return measured(address, kind, 1, None, signal, "enum")


def bits(address: int, signal: str) -> Item:
    """A register of flags."""
    return measured(address, "u16", 1, None, signal, "bit field")
