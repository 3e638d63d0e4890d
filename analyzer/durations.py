"""Durations as people write them: `500ms`, `90s`, `10min`, `1h30m`, `0.3` (seconds).

>>> parse_duration("500ms", "--timeout"), parse_duration("1h30m", "--duration") // 10**9
(500000000, 5400)
"""

from __future__ import annotations

import itertools
import re

from dissectors.errors import UsageError

__all__ = ["MAX_S", "parse_duration"]

MAX_S = 10 * 365 * 24 * 3600

_UNITS_NS = {
    "us": 1_000,
    "ms": 1_000_000,
    "s": 1_000_000_000,
    "min": 60 * 1_000_000_000,
    "m": 60 * 1_000_000_000,
    "h": 3600 * 1_000_000_000,
    "d": 86_400 * 1_000_000_000,
}
_PART = r"(\d+\.?\d*|\.\d+)\s*([a-z]*)\s*"


def parse_duration(text: str, option: str, max_s: float = MAX_S) -> int:
    """A duration in nanoseconds; parts may follow one another, the larger units first.

    `UsageError` names the option if the text is no duration, or is `max_s` or longer.
    """
    word = text.strip().lower()
    parts = re.findall(_PART, word) if re.fullmatch(f"(?:{_PART})+", word) else []
    # A number without a unit is in seconds where it stands alone; in `1h30` it could be anything.
    scales = [_UNITS_NS.get(unit or ("s" if len(parts) == 1 else ""), 0) for _, unit in parts]
    falling = all(larger > smaller for larger, smaller in itertools.pairwise(scales))
    found = sum(float(value) * scale for (value, _), scale in zip(parts, scales, strict=True))
    if not (all(scales) and falling and 0 < found < max_s * _UNITS_NS["s"]):
        raise UsageError(
            f"{option} {text}: give a time in ms, s, min, h or d, such as 500ms, 90s or 1h30m"
        )
    return round(found)
