"""`modlens show FILE --at 3:hr:107 --as all`: registers interpreted as every type, over time."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import _modlens
from analyzer.addresses import SHORT
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.messages import Messages
from analyzer.counts import count_of
from analyzer.filters import parse
from analyzer.views.grid import ColumnLayout, GridColumn
from analyzer.views.registers import show_grid
from analyzer.views.screen import Screen
from dissectors.errors import UsageError
from dissectors.function_lookup import parse_number

__all__ = ["add_place", "show_registers"]

ORDERS = ("ABCD", "CDAB", "BADC", "DCBA")

TYPES_BY_COUNT = {1: ("u16", "s16"), 2: ("u32", "s32", "f32"), 4: ("u64", "s64", "f64")}
"""Number of registers -> the types that take so many."""

MAX_CHANGES = 20
"""Samples that are printed at most; only those with changed values are."""

_PLACE = re.compile(r"(\d+):(hr|ir):(0x[0-9A-Fa-f]+|\d+)")


@dataclass(frozen=True, slots=True)
class Sample:
    """The values of the registers in one transaction."""

    txn: int
    elapsed_us: float | None
    words: tuple[int, ...]


def add_place(parser: argparse.ArgumentParser) -> None:
    """Add `--at`, `--count` and `--as`."""
    parser.add_argument(
        "--at",
        metavar="UNIT:hr:ADDR",
        help="show the values of these registers over time, at unit:hr|ir:address, counting from 0",
    )
    parser.add_argument(
        "--count",
        type=int,
        default=2,
        metavar="N",
        help="with --at: 1, 2 or 4 registers (default: 2)",
    )
    parser.add_argument(
        "--as",
        dest="kind",
        default="all",
        metavar="TYPE",
        help="with --at: one type, such as f32 (default: all)",
    )


def show_registers(options: argparse.Namespace, screen: Screen) -> None:
    """Draw the samples and say which type is plausible; `UsageError` without samples."""
    match = _PLACE.fullmatch(options.at)
    if match is None:
        raise UsageError(f"show: --at {options.at}; write unit, hr or ir, address: 3:hr:107")
    if options.count not in TYPES_BY_COUNT:
        raise UsageError("show: --count is 1, 2 or 4")
    kinds = TYPES_BY_COUNT[options.count]
    if options.kind != "all":
        if options.kind not in kinds:
            raise UsageError(
                f"show: --as {options.kind}: for {options.count} registers {_list(kinds)}"
            )
        kinds = (options.kind,)
    first = parse_number(match[3]) or 0
    samples = _samples(options, int(match[1]), match[2], first)
    if not samples:
        raise UsageError(f"show: no transaction read or wrote all of {options.at}")
    columns = [
        (kind, order) for kind in kinds for order in ORDERS[: 1 if options.count == 1 else 4]
    ]
    best = _best_interpretation(samples, columns)
    changed = [
        sample
        for before, sample in zip([None, *samples], samples, strict=False)
        if before is None or before.words != sample.words
    ]
    screen.line(
        f"{count_of(len(samples), 'sample')}, {count_of(len(changed) - 1, 'change')}", "dim"
    )
    show_grid(_grid_columns(columns, best), changed[:MAX_CHANGES], screen)
    if len(changed) > MAX_CHANGES:
        screen.line(f"... {count_of(len(changed) - MAX_CHANGES, 'more change')}", "dim")
    screen.line(_verdict(best), "good" if best and best["sure"] else "odd")


def _list(words: Sequence[str]) -> str:
    return f"choose from {', '.join(words)}"


def _samples(options: argparse.Namespace, unit: int, space: str, first: int) -> list[Sample]:
    """The values of the registers in all transactions that read or wrote all of them."""
    messages = Messages(quiet=True)
    chosen = replace(settings(options), tables=("transactions",))
    run = file_run(options, chosen, messages, files=options.words)
    kind = next(long for long, short in SHORT.items() if short == space)
    text = f"unit == {unit} and register_type == {kind!r} and touches({space}, {first})"
    wanted = parse(text, "transactions").predicate()
    found = []
    for batch in run.batches():
        for row in batch.transactions.where(wanted):
            for at, data in ((row.write_address, row.write_data), (row.address, row.data)):
                if at is None or data is None or row.status != "ok":
                    continue
                words = tuple(data[first - at : first - at + options.count]) if first >= at else ()
                if len(words) == options.count:
                    found.append(Sample(row.txn, row.elapsed_us, words))
    return found


def _best_interpretation(
    samples: Sequence[Sample], columns: Sequence[tuple[str, str]]
) -> dict[str, Any] | None:
    claims: list[dict[str, Any]] = json.loads(_modlens.judge([one.words for one in samples[:512]]))
    shown = [claim for claim in claims if (claim["type"], claim["order"]) in columns]
    return shown[0] if shown else None


def _grid_columns(
    columns: Sequence[tuple[str, str]], best: dict[str, Any] | None
) -> list[GridColumn]:
    """The columns of the table: transaction, raw words, and one for each type and order.

    The most plausible type and order is marked with an asterisk.
    """

    def field(kind: str, order: str) -> GridColumn:
        is_best = best is not None and (best["type"], best["order"]) == (kind, order)

        def value(sample: Sample) -> str:
            data = b"".join(word.to_bytes(2, "big") for word in sample.words)
            found, text = _modlens.convert(kind, order, data)
            is_float = kind.startswith("f") and found is not None
            return f"{found:.5g}" if is_float else text or "-"

        title = kind if len(columns) <= len(TYPES_BY_COUNT[1]) else f"{kind} {order}"
        head = ColumnLayout(f"*{title}" if is_best else title, 5, align_right=True)
        return GridColumn(head, value, lambda _: "good" if is_best else "")

    return [
        GridColumn(ColumnLayout("txn", 4, align_right=True), lambda sample: str(sample.txn)),
        GridColumn(
            ColumnLayout("raw", 4), lambda sample: " ".join(f"{word:04x}" for word in sample.words)
        ),
        *(field(kind, order) for kind, order in columns),
    ]


def _verdict(best: dict[str, Any] | None) -> str:
    if best is None:
        return "no sign of values that span several registers here"
    sure = "plausible" if best["sure"] else "perhaps"
    return f"{sure}: {best['type']} {best['order']}: {best['reason']}"
