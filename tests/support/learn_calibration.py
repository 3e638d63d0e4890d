"""What the evidence of `modlens learn` is worth, counted on devices whose registers are known.

    python -m tests.support.learn_calibration
    python -m tests.support.learn_calibration --folder FOLDER
    python -m tests.support.learn_calibration --check

Counts claims and wrong ones, keeps them by part in `learn_calibration.json`, and writes their sums
to the crate, `crates/modlens-profiles/src/learn/calibration_table.rs`. A part is a seed of
`tests.support.device_kinds` observed for some minutes, or some devices of
`tests.support.random_devices`. With a folder (see `tests.support.learn_kinds`), its recordings are
parts, too; without it, they stay as they were counted. `--check` writes nothing and fails where a
count differs.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

from analyzer.cli import parser_of
from analyzer.cli.register_survey import points, survey, tables_of
from tests.support.device_kinds import KINDS
from tests.support.learn_kinds import NUMBERS, is_layout_right, lines_of, place, recording
from tests.support.random_devices import RandomDevice

__all__ = ["COUNTS", "PARTS", "TABLE", "counted", "main", "table"]

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "crates" / "modlens-profiles" / "src" / "learn" / "calibration_table.rs"
COUNTS = Path(__file__).with_suffix(".json")

CLASSES = (12, 8, 6, 0)
"""The least bits of evidence of each class of layouts."""

ROLES = (
    "Measurement", "Constant", "Counter", "Enum", "BitField", "Setpoint", "Clock", "Heartbeat",
    "Text",
)  # fmt: skip
LENGTHS = ("1min", "10min", "1h")
"""The recordings of a folder that are counted."""

HEAD = """\
//! Claims and wrong ones among them, counted on simulated devices with known registers. Written by
//! `python -m tests.support.learn_calibration`.

use crate::learn::role::Role;

/// A class of evidence: the least bits of layout claims in it, claims, and wrong ones among them.
"""

Rows = list[dict[str, Any]]


def _kinds(seed: int, minutes: int) -> Iterator[tuple[Rows, Rows]]:
    """The truth about a device of each kind, and what is learned of it."""
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS.values():
            text, truth = recording(kind, seed, 60 * minutes)
            path = Path(folder) / "device.jsonl"
            path.write_text(text)
            yield truth, _learned(path)


def _random(first: int, last: int) -> Iterator[tuple[Rows, Rows]]:
    """The same of random devices, of which only numbers of several registers are judged."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, last + 1):
            plant = RandomDevice(seed)
            path = Path(folder) / "device.hex"
            path.write_text(plant.recording())
            answers = [answer for answer in _learned(path) if answer["count"] > 1]
            truth = [
                {
                    "unit": answers[0]["unit"], "register_type": "holding_register",
                    "address": at, "type": item.kind, "order": item.order,
                    "count": len(item.words(0)), "negative": True,
                }
                for at, item in plant.items.items()
            ]  # fmt: skip
            yield truth, answers


def _recorded(folder: Path, length: str) -> Iterator[tuple[Rows, Rows]]:
    """The same of the recordings of a folder."""
    for path in sorted(folder.glob(f"*.{length}.jsonl.gz")):
        truth = lines_of(path.with_name(path.name.split(".jsonl")[0] + ".truth.jsonl"))
        yield truth, _learned(path)


PARTS: dict[str, Callable[[], Iterator[tuple[Rows, Rows]]]] = {
    **{
        f"kinds, seed {seed}, {minutes} min": partial(_kinds, seed, minutes)
        for seed in range(21, 26)
        for minutes in (10, 60)
    },
    **{
        f"random devices {first}-{first + 7}": partial(_random, first, first + 7)
        for first in range(501, 533, 8)
    },
}
"""What is counted, by name."""


def _learned(path: Path) -> Rows:
    options = parser_of("learn").parse_intermixed_args([str(path)])
    with redirect_stderr(StringIO()):
        found = survey(options)
    return [
        {"unit": table["unit"], "register_type": table["register_type"], **one}
        for table in tables_of(found)
        for chunk in points(found, table)
        for one in chunk
    ]


def counted(devices: Iterator[tuple[Rows, Rows]]) -> dict[str, list[int]]:
    """Claims and wrong ones of each class."""
    found: Counter[str] = Counter()
    for truth, answers in devices:
        known = {place(row): row for row in truth}
        for answer in answers:
            row = known.get(place(answer))
            for name, is_wrong in _claims(row, answer):
                found += Counter({f"{name} claims": 1, f"{name} wrong": int(is_wrong)})
    names = {name.rpartition(" ")[0] for name in found}
    return {name: [found[f"{name} claims"], found[f"{name} wrong"]] for name in sorted(names)}


def _claims(row: dict[str, Any] | None, answer: dict[str, Any]) -> Iterator[tuple[str, bool]]:
    """What an answer claims, and whether that is wrong."""
    is_several = answer["type"] in NUMBERS and (answer["count"] > 1 or answer["type"] == "s16")
    if is_several and answer["layout_evidence"] > 0:
        least = next(bits for bits in CLASSES if answer["layout_evidence"] >= bits)
        yield f"layout {least}", row is None or not is_layout_right(row, answer)
    if row is None or not is_layout_right(row, answer) or "role" not in row:
        return
    if answer["role"] is not None:
        is_still = answer["role"] == "constant" and row["changes"] == 0
        name = answer["role"].title().replace(" ", "").replace("_", "")
        yield f"role {name}", answer["role"] != row["role"] and not is_still
    if row["changes"] and row["role"] in ("measurement", "counter") and row.get("scale"):
        if answer["scale"] is not None:
            yield "scale", abs(answer["scale"] / row["scale"] - 1) > 1e-6
        if answer["quantity"] is not None and row.get("quantity"):
            yield "quantity", answer["quantity"] != row["quantity"]


def table(parts: Mapping[str, Mapping[str, list[int]]]) -> str:
    """The text of the table: the sums of all parts."""

    def total(name: str) -> str:
        rows = [part.get(name, [0, 0]) for part in parts.values()]
        return f"{sum(row[0] for row in rows)}, {sum(row[1] for row in rows)}"

    layouts = ", ".join(f"({bits}.0, {total(f'layout {bits}')})" for bits in CLASSES)
    roles = "".join(f"    (Role::{name}, {total(f'role {name}')}),\n" for name in ROLES)
    return (
        f"{HEAD}pub(super) const LAYOUTS: [(f64, u32, u32); {len(CLASSES)}] = [{layouts}];\n\n"
        "/// Claims of each role, and wrong ones. A register is constant if it was so far.\n"
        f"pub(super) const ROLES: [(Role, u32, u32); {len(ROLES)}] = [\n{roles}];\n\n"
        "/// Claims of a scale, and wrong ones.\n"
        f"pub(super) const SCALES: (u32, u32) = ({total('scale')});\n\n"
        "/// Claims of a quantity, and wrong ones.\n"
        f"pub(super) const QUANTITIES: (u32, u32) = ({total('quantity')});\n"
    )


def main() -> int:
    """Count what the command line names."""
    parser = argparse.ArgumentParser(description="count what the evidence of learn is worth")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--check", action="store_true", help="write nothing, fail on a difference")
    options = parser.parse_args()
    kept = json.loads(COUNTS.read_text()) if COUNTS.exists() else {}
    parts = {name: counted(devices()) for name, devices in PARTS.items()}
    if options.folder:
        for length in LENGTHS:
            parts[f"recordings, {length}"] = counted(_recorded(options.folder, length))
    else:
        parts |= {name: part for name, part in kept.items() if name.startswith("recordings, ")}
    if options.check:
        different = [name for name in kept | parts if kept.get(name) != parts.get(name)]
        is_same = not different and TABLE.read_text() == table(parts)
        sys.stdout.write("as counted\n" if is_same else f"differs: {', '.join(different)}\n")
        return 0 if is_same else 1
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(part)}" for name, part in parts.items())
    COUNTS.write_text(f"{{\n{lines}\n}}\n")
    TABLE.write_text(table(parts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
