"""Options that were given and have no effect: which, and why."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterator

from analyzer.sources import BINARY

__all__ = ["ignored_for", "ignored_in"]

CAPTURES = ("pcap", "pcapng")
FOR_PEOPLE = ("md", "txt")
"""Formats that are tables for people, as the screen has them."""


def ignored_in(options: argparse.Namespace, to: str | None, formats: Collection[str]) -> list[str]:
    """What has no effect in these outputs; `to` is `table`, a format, or None."""
    written = {*formats, *([to] if to is not None else [])}
    found = []
    if options.context and not written & {*CAPTURES}:
        found.append(
            "--context is ignored: frames around a match are for pcap and pcapng outputs, such as"
            ' -o cut.pcapng; in a table, --where "txn >= 1 and txn <= 9" shows those around txn 5'
        )
    if not written & {"table", *FOR_PEOPLE}:
        if options.address != "wire":
            found.append("--address is ignored: files have wire addresses; it is for tables")
        if options.times in ("elapsed", "delta"):
            found.append(f"--times {options.times} is ignored: it is for tables; files have UTC")
    return found


def ignored_for(options: argparse.Namespace, recording_format: str) -> Iterator[str]:
    """What has no effect on a recording of this format."""
    kind = BINARY.get(recording_format)
    is_capture = kind is not None and kind.packets
    if getattr(options, "tcp_ports", None) and not is_capture:
        yield f"--port is ignored: {recording_format} is no network capture"
    if getattr(options, "channels", None) and not (kind is not None and kind.samples):
        yield f"--channels is ignored: {recording_format} is not of a logic analyzer"
    for option in ("timezone", "date"):
        if getattr(options, option, None) and kind is not None:
            yield f"--{option} is ignored: {recording_format} has no times in text"
