"""Tasks for `modlens find` on known devices: one value, three, a history, changes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from random import Random
from statistics import correlation
from typing import Any

from tests.support.kind_rows import Item, Kind
from tests.support.plant_signals import signals

__all__ = ["find_score"]

START = 1_781_515_800.0
ALIKE = 0.99
"""The correlation from which on two signals count as the same."""

LAG = 7.0
"""Seconds by which the clock of the display and of the history is late."""

Curve = list[tuple[float, float]]


def find_score(
    path: Path, truth: list[dict[str, Any]], kind: Kind, seed: int, count: int
) -> Counter[str]:
    """Tasks of each kind, those with the right register first, and among the first three."""
    rng, found = Random(seed), Counter[str]()
    lively = [
        (item, row) for item, row in zip(kind.items, truth, strict=True)
        if item.role in ("measurement", "counter") and row["changes"] * 20 > row["samples"]
    ]  # fmt: skip
    if not count or not lively:
        return found
    curves = _curves(kind, seed, max(row["samples"] for _, row in lively))
    makers: dict[str, Callable[[Item, Curve, Random, Path], list[str]]] = {
        "value": lambda item, curve, rng, _: _values(item, curve, rng, 1),
        "three": lambda item, curve, rng, _: _values(item, curve, rng, 3),
        "history": _history, "changes": _changes,
    }  # fmt: skip
    for name, make in makers.items():
        for _ in range(count):
            item, row = rng.choice(lively)
            words = make(item, curves[item.signal], rng, path.with_suffix(".csv"))
            if not words:
                continue
            same = {
                (other["register_type"], other["address"]) for other in truth
                if _is_alike(curves[other["signal"]], curves[row["signal"]])
            }  # fmt: skip
            ranks = [at for at, one in enumerate(_run(path, words)) if one in same]
            found += Counter({name: 1, f"{name}_first": 0 in ranks, f"{name}_three": bool(ranks)})
    return found


def _curves(kind: Kind, seed: int, samples: int) -> dict[str, Curve]:
    curves: dict[str, Curve] = {item.signal: [] for item in kind.items}
    for at, now in zip(range(samples), signals(seed, kind.seconds), strict=False):
        for name, curve in curves.items():
            curve.append((START + at * kind.seconds, now[name]))
    return curves


def _is_alike(one: Curve, other: Curve) -> bool:
    """Whether two signals move as one, so that histories and changes do not tell them apart."""
    values = [[value for _, value in curve] for curve in (one, other)]
    if any(min(numbers) == max(numbers) for numbers in values):
        return one is other
    return abs(correlation(*values)) > ALIKE


def _digits(item: Item) -> int:
    return 2 if item.type == "f32" else max(0, len(f"{item.scale:.6f}".rstrip("0").split(".")[1]))


def _time(moment: float) -> str:
    return datetime.fromtimestamp(moment, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _values(item: Item, curve: Curve, rng: Random, count: int) -> list[str]:
    words = []
    for moment, value in rng.sample(curve[5:-5], count):
        words += [
            "--value",
            f"{value:.{_digits(item)}f}",
            "--at",
            _time(moment + rng.uniform(0, 3)),
        ]
    return [*words, "--within", "10s"]


def _history(_: Item, curve: Curve, rng: Random, path: Path) -> list[str]:
    factor = rng.choice([1, 0.001])
    rows, last = ["time,value"], 0.0
    for moment, value in curve:
        if moment - last >= 60:
            rows.append(f"{_time(moment + LAG)},{value * factor:.6g}")
            last = moment
    path.write_text("\n".join(rows) + "\n")
    return ["--like", str(path)]


def _changes(item: Item, curve: Curve, rng: Random, _path: Path) -> list[str]:
    """Five intervals in which the value went clearly up or down."""
    span = max(value for _, value in curve) - min(value for _, value in curve)
    words = []
    for _ in range(200):
        first = rng.randrange(5, len(curve) - 40)
        last = first + rng.randrange(12, 36)
        step = curve[last][1] - curve[first][1]
        if abs(step) > max(0.08 * span, 3 * item.scale * (item.type != "f32")):
            words += [
                "--up" if step > 0 else "--down",
                f"{_time(curve[first][0])}..{_time(curve[last][0])}",
            ]
        if len(words) == 10:
            return words
    return []


def _run(path: Path, words: list[str]) -> list[tuple[str, int]]:
    """The registers of the first three candidates."""
    command = [
        sys.executable,
        "-m",
        "analyzer",
        "find",
        str(path),
        *words,
        "--to",
        "jsonl",
        "--limit",
        "3",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    return [(row["register_type"], row["address"]) for row in rows]
