"""Durations as people write them: `500ms`, `90s`, `10min`, `1h30m`, `0.3` (seconds).

>>> parse_duration("500ms", "--timeout"), parse_duration("1h30m", "--duration") // 10**9
(500000000, 5400)
"""

from __future__ import annotations

import _modlens
from dissectors.errors import UsageError

__all__ = ["MAX_S", "parse_duration"]

MAX_S = 10 * 365 * 24 * 3600

_NS_PER_S = 1_000_000_000


def parse_duration(text: str, option: str, max_s: float = MAX_S) -> int:
    """A duration in nanoseconds; parts may follow one another, the larger units first.

    `UsageError` names the option if the text is no duration, or is `max_s` or longer.
    """
    found = _modlens.parse_duration(text)
    if found is None or found >= max_s * _NS_PER_S:
        raise UsageError(
            f"{option} {text}: give a time in ms, s, min, h or d, such as 500ms, 90s or 1h30m"
        )
    return found
