"""The summary of a run: frames and bytes by verdict, transactions by status, findings.

>>> bus = {"frames": {"ok": 2, "noise": 1}, "bytes": {"ok": 15, "noise": 3}}
>>> for line in summary({"buses": [bus], "transactions": {"ok": 1}, "findings": {}}):
...     print(line)
3 frames (18 bytes): ok 2 (15), noise 1 (3)
1 transaction: ok 1
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from analyzer.counts import count_of

__all__ = ["damaged", "summary"]

DAMAGED = ("bad_checksum", "incomplete", "noise")


def summary(stats: Mapping[str, Any]) -> list[str]:
    """The lines of the summary; views/stats.py documents the keys of `stats`."""
    frames, sizes = _total(stats, "frames"), _total(stats, "bytes")
    parts = [f"{name} {count:,} ({sizes[name]:,})" for name, count in frames.items()]
    head = f"{count_of(sum(frames.values()), 'frame')} ({count_of(sum(sizes.values()), 'byte')})"
    lines = [f"{head}{_list(parts)}"]
    states = [f"{status} {count:,}" for status, count in stats["transactions"].items()]
    lines.append(f"{count_of(sum(stats['transactions'].values()), 'transaction')}{_list(states)}")
    codes = [f"{code} {count:,}" for code, count in stats["findings"].items()]
    if codes:
        lines.append(f"findings{_list(codes)} (modlens explain NAME)")
    return lines


def damaged(stats: Mapping[str, Any]) -> int:
    """The number of damaged frames, noise included, without those that the recording cuts."""
    cut: int = sum(bus.get("cut", 0) for bus in stats["buses"])
    return sum(count for name, count in _total(stats, "frames").items() if name in DAMAGED) - cut


def _total(stats: Mapping[str, Any], what: str) -> dict[str, int]:
    """Frames or bytes by verdict over all buses; only verdicts that occurred."""
    total: dict[str, int] = {}
    for bus in stats["buses"]:
        for name, count in bus[what].items():
            total[name] = total.get(name, 0) + count
    return {name: count for name, count in total.items() if count}


def _list(parts: list[str]) -> str:
    return ": " + ", ".join(parts) if parts else ""
