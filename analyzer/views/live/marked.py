"""Registers since a mark: which of them went up, down, stayed the same, or changed.

Each further question leaves those that did, and asks about the time from now on, so that a few of
them find the register of a value that somebody moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["QUESTIONS", "Marked"]

_SIGN = 0x8000
_WRAP = 0x10000

QUESTIONS: dict[str, tuple[str, Callable[[int], bool]]] = {
    "u": ("went up", lambda step: step > 0),
    "j": ("went down", lambda step: step < 0),
    "=": ("stayed the same", lambda step: step == 0),
    "d": ("changed", lambda step: step != 0),
}
"""Key -> what it keeps."""


@dataclass
class Marked:
    """The values at the mark, and the answers since; empty before the first mark."""

    values: dict[Any, int] = field(default_factory=dict)
    answers: list[str] = field(default_factory=list)

    def mark(self, values: Mapping[Any, int]) -> None:
        """Begin again: all registers are candidates."""
        self.values, self.answers = dict(values), []

    def keep(self, key: str, values: Mapping[Any, int]) -> None:
        """Keep the registers that did what the key says since the mark, and mark again."""
        said, fits = QUESTIONS[key]
        kept = {place for place in self.values if fits(self.step(place, values))}
        self.values = {place: values[place] for place in kept}
        self.answers.append(said)

    def step(self, place: Any, values: Mapping[Any, int]) -> int:
        """The step of a register since the mark, across zero the short way.

        >>> marked = Marked({"a": 65535, "b": 7})
        >>> marked.step("a", {"a": 2}), marked.step("b", {"b": 4})
        (3, -3)
        """
        step = (values[place] - self.values[place]) % _WRAP
        return step - _WRAP if step >= _SIGN else step

    def __bool__(self) -> bool:
        return bool(self.values or self.answers)
