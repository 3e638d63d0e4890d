"""The silences t3.5 and t1.5: how long a pause ends a frame, and how long one may be inside.

Modbus over Serial Line V1.02, section 2.5.1.1. Used where frames are cut by silences only.

>>> parse_silence("t35", "3.5chars", 572916), parse_silence("t35", "1750us", None)
(2005206, 1750000)
"""

from __future__ import annotations

import _modlens
from analyzer.line import EXAMPLE, Line
from dissectors.errors import UsageError

__all__ = ["SEGMENTATIONS", "parse_silence", "silence_limits"]

SEGMENTATIONS = ("joint", "silence")
_MAX_NS = 10_000_000_000


def silence_limits(
    segmentation: str,
    t35: str | None,
    t15: str | None,
    line: Line | None,
    *,
    prefix: str = "",
) -> tuple[int, int] | None:
    """t3.5 and t1.5 in nanoseconds; None where frames are found by all evidence (`joint`).

    Where they are not given, they are those of the specification for the line's settings. `prefix`
    is before the names of options in messages. `UsageError` where t3.5 is not known, or is
    shorter than t1.5.
    """
    if segmentation not in SEGMENTATIONS:
        raise UsageError(f"segmentation {segmentation!r}; it is one of {', '.join(SEGMENTATIONS)}")
    if segmentation == SEGMENTATIONS[0]:
        if t35 is not None or t15 is not None:
            raise UsageError(f"{prefix}t35 and {prefix}t15 go with {prefix}segmentation silence")
        return None
    timing = (None, None, None) if line is None else _modlens.line_timing(*line.settings)
    char, inside, ends = timing
    if t35 is not None:
        ends = parse_silence(f"{prefix}t35", t35, char)
    if ends is None:
        raise UsageError(
            f"{prefix}segmentation silence: t3.5 is not known;"
            f" add {prefix}line {EXAMPLE}, or {prefix}t35 1750us"
        )
    if t15 is not None:
        inside = parse_silence(f"{prefix}t15", t15, char)
    if inside is not None and inside > ends:
        raise UsageError(
            f"{prefix}t15 is longer than {prefix}t35; a silence cannot be inside a frame and end it"
        )
    return ends, ends if inside is None else inside


def parse_silence(option: str, text: str, char_ns: int | None) -> int:
    """Parse `1750us` or `3.5chars`; gives nanoseconds, `UsageError` for anything else."""
    word = text.strip().lower()
    unit = next((unit for unit in ("us", "chars", "char") if word.endswith(unit)), "")
    try:
        value = float(word.removesuffix(unit)) if unit else -1.0
    except ValueError:
        value = -1.0
    if unit.startswith("char") and value > 0 and char_ns is None:
        prefix = option[: len(option) - len(option.lstrip("-"))]
        raise UsageError(
            f"{option} {text}: the length of a character is not known; add {prefix}line {EXAMPLE}"
        )
    time = value * (1000 if unit == "us" else char_ns or 0)
    if not 0 < time <= _MAX_NS:
        raise UsageError(f"{option} {text}: write microseconds as 1750us, characters as 3.5chars")
    return round(time)
