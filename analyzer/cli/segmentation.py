"""`--segmentation`: how RTU frames are found, by all evidence or by silences only."""

from __future__ import annotations

import argparse

from analyzer.cli.messages import Messages
from analyzer.settings import Settings
from analyzer.silence_limits import SEGMENTATIONS

__all__ = ["add_segmentation", "report_silence_limits"]


def add_segmentation(group: argparse._ArgumentGroup) -> None:
    """Add `--segmentation`, `--t35` and `--t15`."""
    group.add_argument(
        "--segmentation",
        choices=SEGMENTATIONS,
        default=SEGMENTATIONS[0],
        help="how to find RTU frame boundaries: joint uses checksums, lengths and timing"
        " together (default); silence uses t3.5 alone",
    )
    for name, what, example in (
        ("--t35", "that ends a frame", "1750us or 3.5chars"),
        ("--t15", "allowed inside a frame", "750us or 1.5chars"),
    ):
        group.add_argument(
            name,
            metavar="TIME",
            help=f"with --segmentation silence: the silence {what}, such as {example}",
        )


def report_silence_limits(settings: Settings, messages: Messages) -> None:
    """Report t3.5 and t1.5 where frames are cut by silences."""
    if settings.silence_ns is not None:
        t35, t15 = (f"{ns / 1000:,.0f} us" for ns in settings.silence_ns)
        messages.info(
            f"segmentation by silence: {t35} (t3.5) ends a frame; more than {t15} (t1.5)"
            " inside a frame is reported as a finding"
        )
