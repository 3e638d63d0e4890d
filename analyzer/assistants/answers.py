"""Bounds the answers of the tools: rows are left for the next page, fields are never shortened."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["MAX_CHARACTERS", "Row", "page", "without_empty"]

MAX_CHARACTERS = 8_000
"""Length of an answer. Assistants refuse, or cut blindly, what is much longer."""

_PAGE_CHARACTERS = 200
"""Kept free for the keys that describe the page."""

_SHORT = 60
"""Fields up to this length are never left out."""

Row = tuple[str, Mapping[str, Any]]
"""The name of the list that a row belongs to, and the row."""


def page(head: Mapping[str, Any], rows: Sequence[Row], *, offset: int, total: int) -> str:
    r"""The text of an answer: `head`, then as many of the `rows` as fit, in their lists.

    The first of the `rows` is number `offset` of a `total`. `next_offset` is there if the answer
    ends before the last of them. A row that does not fit into an answer of its own lacks its
    longest fields; `left_out` gives their lengths.

    >>> page({"file": "a"}, [("units", {"unit": 1})], offset=0, total=2)
    '{"file":"a","units":[{"unit":1}],"rows_in_all":2,"next_offset":1}'
    """
    answer: dict[str, Any] = dict(head)
    room = MAX_CHARACTERS - _PAGE_CHARACTERS - len(_text(answer))
    shown = 0
    for name, row in rows:
        list_characters = len(f',"{name}":[]') if name not in answer else len(",")
        fitting = row
        if len(_text(row)) + list_characters > room:
            if shown:
                break
            fitting = _without_long_fields(row, room - list_characters)
        answer.setdefault(name, []).append(fitting)
        room -= len(_text(fitting)) + list_characters
        shown += 1
    answer["rows_in_all"] = total
    if offset + shown < total:
        answer["next_offset"] = offset + shown
    return _text(answer)


def _without_long_fields(row: Mapping[str, Any], room: int) -> dict[str, Any]:
    """The row without its longest fields, as few as are needed to fit."""
    kept, left_out = dict(row), dict[str, int]()
    for key in sorted(row, key=lambda key: -len(_text(row[key]))):
        if len(_text(kept)) + len(_text(left_out)) <= room or len(_text(row[key])) <= _SHORT:
            break
        left_out[key] = len(_text(kept.pop(key)))
    return {**kept, "left_out": left_out}


def _text(value: Any) -> str:
    """JSON in ASCII, so that no character of a recording can hide or reorder others."""
    return json.dumps(value, separators=(",", ":"), default=str)


def without_empty(row: Mapping[str, Any], leave_out: Sequence[str] = ()) -> dict[str, Any]:
    """The row without null, empty lists and objects, and the keys to leave out."""
    return {
        key: value
        for key, value in row.items()
        if value is not None and value not in ({}, []) and key not in leave_out
    }
