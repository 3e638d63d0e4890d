"""Answers end between rows, and all pages together are the whole."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from analyzer.assistants.answers import MAX_CHARACTERS, page

ROWS = st.lists(
    st.dictionaries(st.sampled_from("abc"), st.text(max_size=3000), min_size=1), max_size=12
)


@given(rows=ROWS)
def test_pages_are_the_whole(rows: list[dict[str, str]]) -> None:
    """Each is short enough; no field is shortened, but one that fits no page is left out."""
    found: list[dict[str, Any]] = []
    offset: int | None = 0
    while offset is not None:
        listed = [("rows", row) for row in rows[offset:]]
        text = page({"file": "bus"}, listed, offset=offset, total=len(rows))
        assert len(text) <= MAX_CHARACTERS
        answer = json.loads(text)
        found += answer.get("rows", [])
        assert answer["rows_in_all"] == len(rows)
        assert answer.get("next_offset", len(rows)) > offset or not rows
        offset = answer.get("next_offset")
    assert len(found) == len(rows)
    for row, shown in zip(rows, found, strict=True):
        left_out = shown.pop("left_out", {})
        assert shown == {key: value for key, value in row.items() if key not in left_out}


def test_a_row_that_is_too_long_lacks_its_longest_field() -> None:
    """And says how long that is."""
    row = {"frame": 1, "hex": "00" * 6000, "verdict": "noise"}
    answer = json.loads(page({}, [("rows", row)], offset=0, total=1))
    assert answer["rows"] == [{"frame": 1, "verdict": "noise", "left_out": {"hex": 12002}}]


def test_captured_characters_cannot_hide() -> None:
    """Characters that turn or hide text are escapes."""
    text = page({}, [("rows", {"name": "a\u202eb\u200b\x1b[2J\U000e0041"})], offset=0, total=1)
    assert text.isascii()
    assert text.isprintable()
