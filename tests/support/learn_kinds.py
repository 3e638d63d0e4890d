"""How well `modlens learn` and `modlens find` do on kinds of devices whose registers are known.

    python -m tests.support.learn_kinds --seeds 1-2 --minutes 60
    python -m tests.support.learn_kinds --folder FOLDER --length 1h

Without a folder, the devices are those of `tests.support.device_kinds`, or those that came later
(`--later`), or last (`--unseen`). A folder holds recordings KIND.LENGTH.jsonl.gz and, beside them,
the truth, KIND.LENGTH.truth.jsonl, a line for each value.

A claim about the layout is one about several registers, or about a sign; texts are left out. A
layout is decidable if it has moved enough: an upper register has changed, or a float has had three
values. A role is right, too, if the value was constant so far and is called so; the stricter
figure does not count that.
"""

from __future__ import annotations

import argparse
import gzip
import json
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import _modlens
from tests.support.device_kinds import KINDS
from tests.support.find_tasks import find_score
from tests.support.kind_rows import Item, Kind
from tests.support.later_kinds import KINDS as LATER
from tests.support.plant_signals import signals
from tests.support.unseen_kinds import KINDS as UNSEEN

__all__ = ["is_layout_right", "lines_of", "main", "place", "recording", "score"]

LONG = {"hr": "holding_register", "ir": "input_register"}
READ = {"hr": 3, "ir": 4}
START = 1_781_515_800.0
WIDTHS = {"u32": 2, "s32": 2, "f32": 2, "u64": 4, "s64": 4}
NUMBERS = ("s16", "u32", "s32", "f32", "u64", "s64", "f64")
EVEN = {"u32": "s32", "u64": "s64"}
"""Types that differ only for numbers that were never seen."""

ROWS = (
    ("layout: claims right", "right", "claims"),
    ("layout: decidable found", "found", "decidable"),
    ("layout at 10 bits or more: wrong", "strong_wrong", "strong"),
    ("role: said", "roles", "points"),
    ("role: right", "roles_right", "roles"),
    ("role: right, strict", "roles_strict", "roles"),
    ("scale: said", "scales", "live"),
    ("scale: right", "scales_right", "scales"),
    ("quantity: said", "quantities", "live"),
    ("quantity: right", "quantities_right", "quantities"),
)
"""What is printed: a name, the counted part, and what it is a part of."""

Truth = dict[str, Any]


def recording(kind: Kind, seed: int, seconds: int) -> tuple[str, list[Truth]]:
    """The recording of a device as JSON lines, and the truth about its values."""
    lines: list[str] = []
    seen: dict[Item, list[bytes]] = {item: [] for item in kind.items}
    plant = signals(seed, kind.seconds)
    for at in range(0, seconds, kind.seconds):
        now = next(plant)
        words: dict[int, int] = {}
        for item in kind.items:
            data = encoded(item, now[item.signal])
            seen[item].append(data)
            pairs = zip(data[::2], data[1::2], strict=True)
            for offset, (high, low) in enumerate(pairs):
                words[item.address + offset] = high << 8 | low
        lines += _polls(kind, words, START + at)
    return "".join(lines), [_truth(kind, item, values) for item, values in seen.items()]


def _polls(kind: Kind, words: Mapping[int, int], time: float) -> Iterator[str]:
    for number, (space, first, count) in enumerate(kind.blocks):
        begin = time + 0.08 * number
        request = struct.pack(">BBHH", 1, READ[space], first, count)
        data = b"".join(words.get(at, 0).to_bytes(2, "big") for at in range(first, first + count))
        response = bytes([1, READ[space], len(data)]) + data
        for moment, body in ((begin, request), (begin + 0.02, response)):
            frame = body + _modlens.crc16(body).to_bytes(2, "little")
            yield json.dumps({"t": round(moment, 6), "hex": frame.hex()}) + "\n"


def encoded(item: Item, value: float) -> bytes:
    """The registers of a value."""
    raw = value / item.scale
    if item.type == "f32":
        data = struct.pack(">f", raw)
    else:
        width = 2 * WIDTHS.get(item.type, 1)
        data = (round(raw) & ((1 << 8 * width) - 1)).to_bytes(width, "big")
    words = [data[at : at + 2] for at in range(0, len(data), 2)]
    if item.order in ("BADC", "DCBA"):
        words = [word[::-1] for word in words]
    return b"".join(words[::-1] if item.order in ("CDAB", "DCBA") else words)


def _truth(kind: Kind, item: Item, values: list[bytes]) -> Truth:
    count = WIDTHS.get(item.type, 1)
    space = next(
        space for space, first, size in kind.blocks if first <= item.address < first + size
    )
    changes = sum(a != b for a, b in pairwise(values))
    upper = slice(-2, None) if item.order in ("CDAB", "DCBA") else slice(0, 2)
    moved = len({value[upper] for value in values}) > 1
    negative = item.type[0] == "s" and any(value[upper][0] & 0x80 for value in values)
    decidable = (negative if count == 1 else moved) or (item.type == "f32" and len(set(values)) > 2)
    return {
        "unit": 1, "register_type": LONG[space], "address": item.address, "count": count,
        "type": item.type, "order": item.order, "role": item.role, "scale": item.scale,
        "unit_symbol": item.unit, "quantity": item.quantity, "samples": len(values),
        "changes": changes, "negative": negative, "decidable": decidable, "signal": item.signal,
    }  # fmt: skip


def learned(path: Path) -> list[dict[str, Any]]:
    """What `modlens learn` reports about a recording."""
    words = [sys.executable, "-m", "analyzer", "learn", str(path), "--to", "jsonl"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def score(truth: list[Truth], answers: list[dict[str, Any]]) -> Counter[str]:
    """Claims and right ones."""
    known = {place(row): row for row in truth}
    found: Counter[str] = Counter()
    for answer in answers:
        is_claim = answer["type"] in NUMBERS and (answer["count"] > 1 or answer["type"] == "s16")
        if is_claim:
            right = is_layout_right(known.get(place(answer)), answer)
            strong = answer["layout_bits"] >= 10
            found += Counter(
                claims=1, right=right, strong=strong, strong_wrong=strong and not right
            )
    said = {place(answer): answer for answer in answers}
    for where, row in known.items():
        answer = said.get(where, {})
        laid = bool(answer) and is_layout_right(row, answer)
        found += Counter(points=1, decidable=row["decidable"], found=row["decidable"] and laid)
        if not answer:
            continue
        if answer["role"] is not None:
            same = answer["role"] == row["role"]
            so_far = answer["role"] == "constant" and row["changes"] == 0
            found += Counter(roles=1, roles_strict=same, roles_right=same or so_far)
        if row["changes"] and row["role"] in ("measurement", "counter") and row.get("scale"):
            found["live"] += 1
            if answer["scale"] is not None:
                near = abs(answer["scale"] / row["scale"] - 1) < 1e-6
                found += Counter(scales=1, scales_right=near)
            if answer["quantity"] is not None:
                found += Counter(
                    quantities=1, quantities_right=answer["quantity"] == row["quantity"]
                )
    return +found


def place(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["unit"], row["register_type"], row["address"], row["count"]


def is_layout_right(row: Truth | None, answer: Mapping[str, Any]) -> bool:
    if row is None:
        return False
    kinds = {row["type"], answer["type"]}
    is_kind = len(kinds) == 1 or (
        not row["negative"] and kinds in ({a, b} for a, b in EVEN.items())
    )
    is_order = row["count"] == 1 or answer["order"] == row["order"]
    return (is_kind or (kinds == {"u16", "s16"} and not row["negative"])) and is_order


def _share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f} % ({part} of {whole})" if whole else "-"


def report(found: Counter[str]) -> str:
    """The figures as lines of text."""
    rows = list(ROWS)
    for kind in ("value", "three", "history", "changes"):
        rows += [(f"find, {kind}: first", f"{kind}_first", kind)]
        rows += [(f"find, {kind}: in three", f"{kind}_three", kind)]
    shares = [(name, _share(found[part], found[whole])) for name, part, whole in rows]
    return "".join(f"{name:34} {share}\n" for name, share in shares)


def main() -> None:
    """Measures what the command line names."""
    parser = argparse.ArgumentParser(description="accuracy of modlens learn and find")
    parser.add_argument("--seeds", default="1-2", metavar="FIRST-LAST")
    parser.add_argument("--minutes", type=int, default=60)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--length", default="1h")
    parser.add_argument("--later", action="store_true", help="those of `tests.support.later_kinds`")
    parser.add_argument("--unseen", action="store_true", help="of `tests.support.unseen_kinds`")
    parser.add_argument(
        "--kind", choices=[*KINDS, *LATER, *UNSEEN], help="only this kind, with its mistakes"
    )
    parser.add_argument("--find", type=int, default=0, metavar="N", help="N tasks a kind of task")
    options = parser.parse_args()
    first, last = map(int, options.seeds.split("-"))
    kinds = UNSEEN if options.unseen else LATER if options.later else KINDS
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        if options.folder:
            for path in sorted(options.folder.glob(f"*.{options.length}.jsonl.*z")):
                truth = lines_of(path.with_name(path.name.split(".jsonl")[0] + ".truth.jsonl"))
                total += score(truth, learned(path))
        else:
            for seed in range(first, last + 1):
                for name, kind in kinds.items():
                    if options.kind in (None, name):
                        path = Path(folder) / f"{name}.jsonl"
                        text, truth = recording(kind, seed, 60 * options.minutes)
                        path.write_text(text)
                        answers = learned(path)
                        total += score(truth, answers)
                        total += find_score(path, truth, kind, seed, options.find)
                        if options.kind:
                            sys.stdout.write(_mistakes(truth, answers))
    sys.stdout.write(report(total))


def _mistakes(truth: list[Truth], answers: list[dict[str, Any]]) -> str:
    said = {(row["register_type"], row["address"]): row for row in answers}
    lines = []
    for row in truth:
        answer = said.get((row["register_type"], row["address"]), {})
        keys = ("type", "order", "role", "scale", "quantity")
        pairs = [f"{key} {row[key]}/{answer.get(key)}" for key in keys]
        lines.append(f"{row['address']:6} {row['signal']:12} {'; '.join(pairs)}\n")
    return "".join(lines)


def lines_of(path: Path) -> list[dict[str, Any]]:
    data = path.read_bytes()
    text = gzip.decompress(data) if path.suffix == ".gz" else data
    return [json.loads(line) for line in text.splitlines()]


if __name__ == "__main__":
    main()
