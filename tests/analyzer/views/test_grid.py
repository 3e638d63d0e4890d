"""Tables that are printed while they grow."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from analyzer.views.grid import Field, Grid, Head, Items, Run
from analyzer.views.screen import Part


def text_of(parts: list[Part]) -> str:
    """A line without its styles."""
    return "".join(text for text, _ in parts)


def grid(heads: list[Head], rows: list[list[str]], width: int) -> Grid:
    """A grid of plain cells."""
    fields = [
        Field(head, lambda row, index=index: row[index])  # type: ignore[misc]
        for index, head in enumerate(heads)
    ]
    return Grid(fields, rows, width)


def test_columns_are_as_wide_as_the_first_rows() -> None:
    """Numbers to the right, texts to the left."""
    table = grid([Head("n", right=True), Head("name")], [["1", "pump"], ["100", "fan"]], 80)
    assert text_of(table.head()) == "  n name"
    assert text_of(table.line(["7", "fan"])) == "  7 fan "


def test_a_later_number_pushes_its_line() -> None:
    """It is never cut."""
    table = grid([Head("n", right=True), Head("name")], [["1", "pump"]], 80)
    assert text_of(table.line(["123456", "fan"])) == "123456 fan "


def test_a_text_with_a_limit_is_cut() -> None:
    """From the first row on."""
    table = grid([Head("name", most=6)], [["a long name"]], 80)
    assert text_of(table.line(["a long name"])) == "a lon…"


def test_shares_fill_the_line() -> None:
    """By weight, to the last column."""
    table = grid([Head("a", share=1), Head("b", share=2), Head("n")], [["", "", "x"]], 40)
    assert len(text_of(table.head())) == 40
    assert len(text_of(table.line(["x" * 50, "y" * 50, "z"]))) == 40


def test_a_narrow_terminal_gets_the_least_widths() -> None:
    """Nothing becomes negative."""
    table = grid([Head("name", 8, share=1), Head("n")], [["a", "1"]], 5)
    assert text_of(table.line(["abcdefghijk", "1"])) == "abcdefg… 1"


@given(st.lists(st.integers(0, 65535).map(str)), st.integers(1, 60))
def test_items_are_shown_as_far_as_they_fit(values: list[str], width: int) -> None:
    """All of them, or some and the number of the others."""
    shown = Items(values).within(width)
    if "…" not in shown:
        assert shown == " ".join(values)
    else:
        begun, _, more = shown.partition("…")
        assert begun.split() == values[: len(begun.split())]
        assert len(begun.split()) + int(more.strip().removeprefix("+")) == len(values)
        assert len(shown) <= width or not begun


def test_items_can_stand_for_several() -> None:
    """Groups of bits count as bits."""
    assert Items(["10110011", "10110011", "1"], [8, 8, 1]).within(14) == "10110011 … +9"


@given(st.lists(st.text("abc", max_size=9), max_size=5), st.integers(0, 40))
def test_a_run_never_takes_more_than_its_room(texts: list[str], width: int) -> None:
    """What is behind the end is left out."""
    run = Run([(text, "") for text in texts] + [(Items(["1", "2", "3"]), "")])
    assert len(text_of(run.within(width))) <= width
