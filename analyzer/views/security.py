"""Draws findings of security rules and deviations from a baseline, or writes them as text."""

from __future__ import annotations

import csv
import io
import json
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

from analyzer.views.screen import Screen, visible
from analyzer.visible import spreadsheet_cell

__all__ = ["FORMATS", "render", "show_findings"]

FORMATS = ("jsonl", "csv", "md")

_STYLES = {"high": "bad", "medium": "odd", "low": "note", "info": "dim"}
_WIDEST = 100
_ONE_YEAR_NS = 31_536_000_000_000_000


def show_findings(rows: Sequence[Mapping[str, Any]], screen: Screen) -> None:
    """Show each finding: what was seen, what it means, what to check, when it is normal."""
    width = min(screen.width, _WIDEST)
    for number, row in enumerate(rows, 1):
        screen.lines(
            [[(f"{number}. {row['severity']} ", _STYLES[row["severity"]]), (row["code"], "head")]]
        )
        technique = f"{row['technique']} {row['technique_name']}".strip()
        seen = " ".join(part for part in (_when(row), _examples(row)) if part)
        for text in (
            f"{row['sentence']} {seen}".rstrip(),
            row["meaning"],
            f"Check: {row['check']}",
            f"Normal: {row['normal']}",
            f"ATT&CK: {technique}" if technique else "",
        ):
            for line in textwrap.wrap(visible(text), max(width - 3, 20)):
                screen.line(f"   {line}")


def _when(row: Mapping[str, Any]) -> str:
    since = row["since_ns"]
    return "" if since is None else f"First {time_text(since)}."


def time_text(ns: int) -> str:
    """A moment since 1970 as UTC, or seconds since the start where the recording has no date.

    >>> time_text(1_500_000_000), time_text(1_700_000_000_000_000_000)
    ('at 1.500 s', '2023-11-14T22:13:20.000Z')
    """
    if abs(ns) < _ONE_YEAR_NS:
        return f"at {ns / 1e9:.3f} s"
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=ns // 1000)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _examples(row: Mapping[str, Any]) -> str:
    numbers = ", ".join(map(str, row["examples"]))
    return f"Transactions: {numbers}." if numbers else ""


def render(rows: Sequence[Mapping[str, Any]], form: str) -> str:
    """The findings in one of `FORMATS`."""
    if form == "jsonl":
        return "".join(json.dumps(_without_null(row), ensure_ascii=False) + "\n" for row in rows)
    return _csv(rows) if form == "csv" else "".join(_markdown(rows))


def _without_null(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if value is not None}


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    keys = [
        *("code", "severity", "technique", "technique_name", "bus", "client", "unit", "function"),
        *("address", "quantity", "count", "since_ns", "until_ns", "sentence", "meaning", "check"),
        *("normal", "examples"),
    ]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(keys)
    for row in rows:
        writer.writerow([spreadsheet_cell(row[key]) for key in keys])
    return text.getvalue()


def _markdown(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    yield "| severity | finding | what was seen | check |\n| --- | --- | --- | --- |\n"
    for row in rows:
        cells = (
            row["severity"],
            f"`{row['code']}`",
            _escaped(row["sentence"]),
            _escaped(row["check"]),
        )
        yield f"| {' | '.join(cells)} |\n"


def _escaped(text: str) -> str:
    return visible(text).replace("\\", "\\\\").replace("|", "\\|")
