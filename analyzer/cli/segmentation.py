"""`--segmentation`: where frames end, by evidence or by the textbook.

>>> duration("--t35", "3.5chars", 572916), duration("--t35", "1750us", None)
(2005206, 1750000)
"""

from __future__ import annotations

import argparse

import _modlens
from analyzer.cli.notes import Notes
from analyzer.line import EXAMPLE, Line
from analyzer.session import Settings
from dissectors.errors import UsageError

__all__ = ["add_segmentation", "announce", "duration", "silences"]

_WORDS = ("joint", "silence")
_MOST_NS = 10_000_000_000


def add_segmentation(group: argparse._ArgumentGroup) -> None:
    """`--segmentation`, `--t35`, `--t15`."""
    group.add_argument(
        "--segmentation",
        choices=_WORDS,
        default=_WORDS[0],
        help="RTU frames end where all evidence together says (joint), or at silences of t3.5 only",
    )
    for name, what in (("--t35", "that ends a frame"), ("--t15", "allowed inside one")):
        group.add_argument(
            name,
            metavar="TIME",
            help=f"with --segmentation silence: the silence {what}, as 1750us or 3.5chars",
        )


def silences(options: argparse.Namespace, line: Line | None) -> tuple[int, int] | None:
    """t3.5 and t1.5 in nanoseconds, the specification's where they are not given; None for joint.

    `UsageError` where they are not known.
    """
    if options.segmentation == _WORDS[0]:
        if options.t35 is not None or options.t15 is not None:
            raise UsageError("--t35 and --t15 go with --segmentation silence")
        return None
    char, t15, t35 = (None, None, None) if line is None else _modlens.line_timing(*line.settings)
    if options.t35 is not None:
        t35 = duration("--t35", options.t35, char)
    if t35 is None:
        raise UsageError(
            f"--segmentation silence: how long is t3.5? Add --line {EXAMPLE}, or --t35 1750us"
        )
    if options.t15 is not None:
        t15 = duration("--t15", options.t15, char)
    if t15 is not None and t15 > t35:
        raise UsageError("--t15 is longer than --t35; a pause would end a frame and be inside it")
    return t35, t35 if t15 is None else t15


def duration(option: str, text: str, char_ns: int | None) -> int:
    """Nanoseconds of `1750us` or `3.5chars`; `UsageError` for anything else."""
    word = text.strip().lower()
    unit = next((unit for unit in ("us", "chars", "char") if word.endswith(unit)), "")
    try:
        value = float(word.removesuffix(unit)) if unit else -1.0
    except ValueError:
        value = -1.0
    if unit.startswith("char") and value > 0 and char_ns is None:
        raise UsageError(f"{option} {text}: how long is a character? Add --line {EXAMPLE}")
    time = value * (1000 if unit == "us" else char_ns or 0)
    if not 0 < time <= _MOST_NS:
        raise UsageError(f"{option} {text}: write microseconds as 1750us, characters as 3.5chars")
    return round(time)


def announce(settings: Settings, notes: Notes) -> None:
    """Say which silences frames are cut by."""
    if settings.silence_ns is not None:
        t35, t15 = (f"{ns / 1000:,.0f} us" for ns in settings.silence_ns)
        notes.say(
            f"segmentation by silence: a frame ends after {t35} (t3.5); more than {t15} (t1.5)"
            " inside one is a finding"
        )
