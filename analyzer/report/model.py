"""What a report shows of a document: sections of texts and tables, by the table `layout.toml`.

Nothing here knows HTML. `assets/model.js` is the same in the words of a browser, for documents that
are dropped on a page; tests compare what the two show.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from analyzer.visible import visible

__all__ = [
    "URGENT",
    "VERDICTS",
    "cell",
    "columns",
    "diagnoses",
    "examples",
    "layout",
    "matrix",
    "percent",
    "rows_at",
    "sections",
    "summary",
    "table",
]

Row = dict[str, Any]

VERDICTS = {
    "healthy": "healthy",
    "trouble": "trouble",
    "broken": "broken",
    "unknown": "not enough to judge",
}

URGENT = 3
"""Causes on the first page; the others are in the appendix."""

_PRINTED = 2
_SEVERITIES = ("error", "warning", "info")
_FAILED = ("no_response", "bad_request", "bad_response")


@cache
def layout() -> dict[str, Any]:
    """The table of sections."""
    return tomllib.loads(Path(__file__).with_name("layout.toml").read_text("utf-8"))


def summary(document: Mapping[str, Any]) -> dict[str, str]:
    """Returns the name, the period and the sources; a document from elsewhere may have none."""
    found = document.get("summary", {})
    return {key: visible(found.get(key, "")) for key in ("name", "period", "sources")}


def sections(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The sections that are shown: optional ones only where they have a row."""
    return [
        section
        for section in layout()["section"]
        if not (path := section.get("optional"))
        or rows_at(document, section["rows"] if path is True else path)
    ]


def rows_at(document: Any, path: str) -> list[Row]:
    """The rows at a path, `x[].y[]`; each has the plain values of the rows around it as well.

    >>> rows_at({"buses": [{"bus": "a", "units": [{"unit": 1}]}]}, "buses[].units[]")
    [{'bus': 'a', 'unit': 1}]
    """
    found: list[Row] = [document]
    for part in path.split("."):
        deeper: list[Row] = []
        for row in found:
            value = row.get(part.removesuffix("[]"))
            around = {} if row is document else {k: v for k, v in row.items() if not _is_nested(v)}
            items = value or [] if part.endswith("[]") else [value] if value else []
            deeper += [{**around, **item} for item in items]
        found = deeper
    return found


def _is_nested(value: Any) -> bool:
    return isinstance(value, dict | list)


def table(document: Mapping[str, Any], section: Mapping[str, Any]) -> dict[str, Any]:
    """Titles, texts and alignment of a section's table; columns without any text are left out."""
    chosen = columns(document, section)
    found = rows_at(document, section["rows"])[: section.get("most", 500)]
    texts = [[cell(document, column, row) for row in found] for column in chosen]
    kept = [at for at, column in enumerate(chosen) if column["as"] == "plot" or any(texts[at])]
    return {
        "head": [chosen[at]["title"] for at in kept],
        "rows": [[texts[at][number] for at in kept] for number in range(len(found))],
        "right": [chosen[at]["as"] in _RIGHT for at in kept],
    }


_RIGHT = ("number", "int", "some", "ms", "seconds", "percent", "load", "share", "total")


def columns(document: Mapping[str, Any], section: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The columns of a section; those that tell buses apart only where there are several."""
    several = len(document["statistics"]["buses"]) > 1
    return [
        column
        for column in section["columns"]
        if several or not column.get("only_with_several_buses")
    ]


def cell(document: Mapping[str, Any], column: Mapping[str, Any], row: Row) -> str:
    """The text of a cell; empty where there is no value.

    >>> cell({}, {"path": "time_us", "as": "ms"}, {"time_us": 12345.5})
    '12.3'
    >>> cell({}, {"path": "a", "of": "b", "as": "share"}, {"a": 1, "b": 3})
    '33.3 %'
    """
    value = _value(row, column.get("path", ""))
    if value is None and "or" in column:
        value = _value(row, column["or"])
    if value is None:
        return ""
    write = _WRITERS.get(column["as"])
    if write is not None:
        return write(value)
    match column["as"]:
        case "share":
            whole = _value(row, column["of"])
            return percent(value / whole) if whole else ""
        case "function":
            return visible(f"{value} {document['functions'].get(str(value), '')}".strip())
        case _:
            return plain(value)


def plain(value: Any) -> str:
    r"""A value as text; numbers as JSON writes them in a browser, six decimals at most.

    >>> plain(12.0), plain(0.1), plain("a\u202eb")
    ('12', '0.1', 'a\\u202eb')
    """
    if isinstance(value, bool | str):
        return visible(str(value))
    if isinstance(value, float) and not value.is_integer():
        text = fixed(value, 6, group=False).rstrip("0")
        return text.removesuffix(".")
    return str(int(value))


def fixed(value: float, decimals: int, *, group: bool = True) -> str:
    """A number with so many decimals, halves away from 0, thousands by commas.

    >>> fixed(1234567.25, 1), fixed(-0.5, 0)
    ('1,234,567.3', '-1')
    """
    scaled = math.floor(abs(value) * 10**decimals + 0.5)
    whole, rest = divmod(scaled, 10**decimals)
    text = f"{whole:,}" if group else str(whole)
    if decimals:
        text += f".{rest:0{decimals}d}"
    return f"-{text}" if value < 0 and scaled else text


def percent(share: float) -> str:
    """A share in percent; 0 % and 100 % are shown for none and all only."""
    if share in (0, 1):
        return "100 %" if share else "0 %"
    least, most = (0.1, 99.9) if 0 < share < 1 else (0.0, math.inf)
    return f"{fixed(min(max(share * 100, least), most), 1)} %"


def milliseconds(microseconds: float) -> str:
    """Microseconds as milliseconds, with about three digits.

    >>> [milliseconds(us) for us in (1, 150, 4694.56, 52_345, 59_752_048)]
    ['0.001', '0.150', '4.69', '52.3', '59,752']
    """
    value = microseconds / 1000
    return fixed(value, sum(value < limit for limit in (1, 10, 100)))


_MOMENT = re.compile(r"(\d{4}-\d\d-\d\d)T(\d\d:\d\d:\d\d)(?:\.(\d+))?Z?")


def moment(text: str) -> str:
    """Writes a time as people do, to the millisecond; the zone is stated once, at the top.

    >>> moment("2026-06-21T02:51:00.693962006Z"), moment("12.5 s")
    ('2026-06-21 02:51:00.693', '12.5 s')
    """
    found = _MOMENT.fullmatch(text)
    if found is None:
        return visible(text)
    return f"{found[1]} {found[2]}.{(found[3] or '').ljust(3, '0')[:3]}"


def words(text: str) -> str:
    """A name of the tables as words."""
    return visible(text).replace("_", " ")


def _counts_of(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{words(key)} {fixed(count, 0)}" for key, count in counts.items() if count)


_WRITERS: dict[str, Callable[[Any], str]] = {
    "plot": lambda _: "",
    "int": lambda value: fixed(value, 0),
    "some": lambda value: fixed(value, 0) if value else "",
    "ms": milliseconds,
    "seconds": lambda value: fixed(value / 1e6, 1),
    "percent": percent,
    "counts": _counts_of,
    "total": lambda value: fixed(sum(value.values()), 0),
    "list": lambda value: visible(", ".join(map(str, value))),
    "load": lambda value: percent(value) if value else "",
    "yes": lambda value: "yes" if value else "",
    "words": words,
    "time": lambda value: moment(str(value)),
}
"""How a value is written that needs nothing but itself, by the word in the column's `as`."""


def diagnoses(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """The diagnoses as cards: title, level, facts, texts, numbers of example transactions."""
    several = len(document["statistics"]["buses"]) > 1
    known = {row["txn"] for row in document["overview"]["examples"]}
    for row in document["doctor"]["diagnoses"]:
        yield {
            "level": row["severity"] if row["severity"] in _SEVERITIES else "info",
            "title": _title(row),
            "code": visible(row["code"]),
            "facts": list(_facts(row, several=several)),
            "texts": [
                ["", visible(" ".join(filter(None, (row["sentence"], row.get("evidence")))))],
                ["Check", visible(row["advice"])],
                ["Proof", visible(row["proof"])],
            ],
            "examples": [number for number in row["examples"] if number in known],
        }


def _title(row: Mapping[str, Any]) -> str:
    """What is wrong, after the unit that it is about."""
    title = visible(row["title"] or row["code"])
    if row.get("unit") is None:
        return title[:1].upper() + title[1:]
    return f"Unit {row['unit']}: {title}"


def _facts(row: Mapping[str, Any], *, several: bool) -> Iterator[list[str]]:
    if several:
        yield ["bus", plain(row["bus"])]
    for name in ("unit", "function", "address", "client"):
        if row.get(name) is not None:
            yield [name, plain(row[name])]
    yield ["seen in", f"{fixed(row['failed'], 0)} of {fixed(row['total'], 0)}"]
    for name in ("since", "until"):
        if row.get(name) is not None:
            yield [name, moment(str(row[name]))]
    if row.get("certainty", "diagnosed") != "diagnosed":
        yield ["certainty", visible(row["certainty"])]


def matrix(document: Mapping[str, Any], section: Mapping[str, Any]) -> dict[str, Any]:
    """Head and rows of the matrix: transactions, failures and exceptions by unit and function."""
    rows = rows_at(document, section["rows"])
    several = len(document["statistics"]["buses"]) > 1
    functions = sorted({row["function"] for row in rows})
    units = list(dict.fromkeys((row["bus"] if several else "", row["unit"]) for row in rows))
    counts = {(row["bus"] if several else "", row["unit"], row["function"]): row for row in rows}
    head = ["unit", *(cell(document, _FUNCTION, {"function": code}) for code in functions)]
    body = []
    for bus, unit in units:
        name = f"{visible(bus)} {unit}".strip()
        body.append([name, *(_counts(counts.get((bus, unit, code))) for code in functions)])
    return {"head": head, "rows": body, "right": [False] * len(head)}


_FUNCTION = {"path": "function", "as": "function"}


def _counts(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return ""
    failed = sum(row["statuses"].get(status, 0) for status in _FAILED)
    refused = row["statuses"].get("exception", 0)
    parts = [fixed(row["transactions"], 0)]
    parts += [f"{fixed(failed, 0)} failed"] * bool(failed)
    parts += [f"{fixed(refused, 0)} exception{'s' * (refused != 1)}"] * bool(refused)
    return ", ".join(parts)


def examples(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """The example transactions: title, findings, frames with their blocks, whether it is printed.

    Two of each of the first causes are; they come first.
    """
    several = len(document["statistics"]["buses"]) > 1
    urgent = document["doctor"]["diagnoses"][:URGENT]
    named = {txn for row in urgent for txn in row["examples"][:_PRINTED]}
    for row in sorted(document["overview"]["examples"], key=lambda row: row["txn"] not in named):
        function = cell(document, _FUNCTION, row)
        facts = [f"transaction {row['txn']}", f"unit {row['unit']}", f"function {function}"]
        facts.append(words(row["status"]))
        if several:
            facts.insert(1, visible(row["bus"]))
        for name, title in (("response_time_us", "answered after"), ("waited_us", "waited")):
            if row[name] is not None:
                facts.append(f"{title} {milliseconds(row[name])} ms")
        if row["time"] is not None:
            facts.append(moment(row["time"]))
        frames = [
            {"title": visible(one["title"]), "rows": [_piece(piece) for piece in one["pieces"]]}
            for one in row.get("frames") or []
        ]
        yield {
            "txn": row["txn"],
            "title": ", ".join(facts),
            "named": row["txn"] in named,
            "findings": visible(", ".join(row["findings"])),
            "frames": frames,
        }


def _piece(piece: Sequence[Any]) -> dict[str, Any]:
    offset, data, name, value, meaning, is_valid = piece
    texts = [str(offset), visible(data), visible(name), visible(value), visible(meaning or "")]
    return {"cells": texts, "wrong": not is_valid}


def _value(row: Mapping[str, Any], path: str) -> Any:
    found: Any = row
    for key in path.split("."):
        found = found.get(key) if isinstance(found, dict) else None
    return found
