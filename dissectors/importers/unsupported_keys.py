"""Notes on keys that the format of another program cannot hold.

>>> unsupported = UnsupportedKeys("Telegraf")
>>> unsupported.add("unit", "flow")
>>> unsupported.add("unit", "level")
>>> unsupported.notes()
['unit cannot be kept in Telegraf: flow, level']
"""

from __future__ import annotations

from dissectors.profile import Profile

__all__ = ["UnsupportedKeys"]

_NAMED = 5
"""Points that a note names at most; the others are counted."""


class UnsupportedKeys:
    """Collects the keys that were left out, and the points that had them."""

    def __init__(self, program: str) -> None:
        self.program = program
        self._points: dict[str, list[str]] = {}

    def add(self, key: str, name: str) -> None:
        """Add a key of a point."""
        self._points.setdefault(key, []).append(name)

    def device(self, profile: Profile) -> None:
        """Add all keys of the device; its order is written with each point."""
        for key in profile.device:
            if key not in ("address_base", "order"):
                self.add(key, "the device")

    def notes(self) -> list[str]:
        """One note for each key."""
        return [
            f"{key} cannot be kept in {self.program}: {_list(of)}"
            for key, of in self._points.items()
        ]


def _list(names: list[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
