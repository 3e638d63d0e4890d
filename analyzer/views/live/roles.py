"""What registers are for, a letter each, while a line is tapped: what `modlens learn` would say."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from typing import Any

import _modlens

__all__ = ["LETTERS", "Roles"]

LETTERS = {
    "counter": "c", "measurement": "m", "enum": "e", "bit field": "b", "setpoint": "s",
    "constant": "k", "clock": "t", "heartbeat": "h", "text": "x",
}  # fmt: skip
"""Role -> its letter."""

UNDECIDED = "~"
"""The letter of a register that moved, and of which more is not known."""

REST = "+"
"""The letter of the further registers of a number."""

_PERIOD_S = 10.0
_EFFORT = 50
"""What was learned is kept for so long, and so many times as long as it took to learn it."""

_MOST = 1 << 16


class Roles:
    """The letters of registers, by unit, type of register and address."""

    def __init__(self) -> None:
        self._survey = _modlens.Survey()
        self._letters: dict[tuple[int, str, int], str] = {}
        self._until = float("-inf")

    def add(self, batch: _modlens.Batch) -> None:
        """Add what a batch read and wrote."""
        self._survey.add(batch)

    def letters(self, now: float) -> Mapping[tuple[int, str, int], str]:
        """The letters of all registers; they are found every ten seconds at most."""
        if now >= self._until:
            began = time.monotonic()
            self._letters = dict(self._found())
            effort = _EFFORT * (time.monotonic() - began)
            self._until = now + max(_PERIOD_S, effort)
        return self._letters

    def _found(self) -> dict[tuple[int, str, int], str]:
        found: dict[tuple[int, str, int], str] = {}
        for table in json.loads(self._survey.tables()):
            if table["space"] not in ("hr", "ir"):
                continue
            unit, kind = table["unit"], table["register_type"]
            for one in json.loads(self._survey.points(unit, table["space"], 0, _MOST)):
                letter = _letter(one)
                if letter:
                    first = one["address"]
                    found[unit, kind, first] = letter
                    found |= {(unit, kind, first + at): REST for at in range(1, one["count"])}
        return found


def _letter(one: Mapping[str, Any]) -> str:
    """The letter of a point; empty for a register that never moved and holds nothing."""
    if one["role"] is None or (one["role"] == "constant" and one["min"] == one["max"] == 0):
        return UNDECIDED if one["changes"] else ""
    return LETTERS[one["role"]]
