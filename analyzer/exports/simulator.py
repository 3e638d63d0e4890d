"""Configuration of pymodbus' simulator, which answers reads with the last recorded values.

`pymodbus.simulator --json_file bus.simulator.json --modbus_device unit_17` serves one unit. Each
unit that was seen is a device. Addresses that were never seen are invalid, so that they are
refused, as the real unit would refuse most of them.
"""

from __future__ import annotations

import json
from typing import Any

import _modlens
from analyzer import exports

__all__ = ["Format"]

SIZE_KEYS = {
    "coil": "co size",
    "discrete_input": "di size",
    "input_register": "ir size",
    "holding_register": "hr size",
}
"""Register type -> key of its block size, in the order in which pymodbus lays out the blocks."""

BIT_TYPES = ("coil", "discrete_input")
BITS_PER_CELL = 16

STATUSES_WITH_VALUES = ("ok", "broadcast", "unsolicited")
"""Status values of transactions whose values are certainly those of the unit."""


class Format(exports.Format):
    """Collects the newest value of every register and bit; the file is written at the end."""

    tables = ("readings",)
    has_column_choice = False
    readable_while_written = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        self._values: dict[Any, dict[str, dict[Any, int]]] = {}

    def encode(self, table: _modlens.Table) -> bytes:
        """Collect values; gives no bytes, because a later row may have a newer value."""
        keys = ("unit", "register_type", "address", "status", "raw")
        for unit, kind, address, status, raw in table.tuples(keys):
            if (
                status in STATUSES_WITH_VALUES
                and kind in SIZE_KEYS
                and address is not None
                and raw is not None
            ):
                spaces = self._values.setdefault(unit, {kind: {} for kind in SIZE_KEYS})
                # With a profile, a row is a point, whose raw value may be several registers.
                for at, value in enumerate(str(raw).split(), int(address)):
                    spaces[str(kind)][at] = int(value)
        return b""

    def footer(self) -> bytes:
        """The whole configuration."""
        devices = {
            f"unit_{unit}": _device_configuration(self._values[unit])
            for unit in sorted(self._values)
        }
        server = {"comm": "tcp", "host": "127.0.0.1", "port": 5020, "framer": "socket"}
        setup = {"server_list": {"server": server}, "device_list": devices}
        return (json.dumps(setup, indent=1) + "\n").encode()


def _device_configuration(spaces: dict[str, dict[int, int]]) -> dict[str, Any]:
    """The device of one unit: its four blocks in sequence, bits packed sixteen to a cell."""
    setup: dict[str, Any] = {"shared blocks": False, "type exception": False}
    setup["defaults"] = {
        "value": {
            "bits": 0,
            "uint16": 0,
            "uint32": 0,
            "float32": 0.0,
            "float64": 0.0,
            "string": " ",
        },
        "action": dict.fromkeys(("bits", "uint16", "uint32", "float32", "float64", "string")),
    }
    bits: list[dict[str, int]] = []
    words: list[dict[str, int]] = []
    seen: set[int] = set()
    start = 0
    for kind, size_key in SIZE_KEYS.items():
        cells = _pack_bits(spaces[kind]) if kind in BIT_TYPES else spaces[kind]
        size = max(cells, default=0) + 1
        setup[size_key] = size
        found = [{"addr": start + at, "value": value} for at, value in sorted(cells.items())]
        (bits if kind in BIT_TYPES else words).extend(found)
        seen |= {start + at for at in cells}
        start += size
    invalid = [at for at in range(start) if at not in seen]
    return {
        "setup": setup,
        "invalid": _ranges(invalid),
        "write": _ranges(sorted(seen)),
        "bits": bits,
        "uint16": words,
        "uint32": [],
        "float32": [],
        "float64": [],
        "string": [],
        "repeat": [],
    }


def _pack_bits(bits: dict[int, int]) -> dict[int, int]:
    cells: dict[int, int] = {}
    for address, bit in bits.items():
        cells[address // BITS_PER_CELL] = (
            cells.get(address // BITS_PER_CELL, 0) | (bit & 1) << address % BITS_PER_CELL
        )
    return cells


def _ranges(numbers: list[int]) -> list[list[int]]:
    """Sorted numbers as the first and last number of each run.

    >>> _ranges([1, 2, 3, 7])
    [[1, 3], [7, 7]]
    """
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][1] == number - 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return runs
