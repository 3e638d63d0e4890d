"""Small tables: widths and sides. The lines of rows are the core's; see test_table."""

from __future__ import annotations

from analyzer.views.grid import ColumnLayout, Grid, GridColumn
from analyzer.views.screen import Part


def text_of(parts: list[Part]) -> str:
    """A line without its styles."""
    return "".join(text for text, _ in parts)


def grid(heads: list[ColumnLayout], rows: list[list[str]], width: int) -> Grid:
    """A grid of plain cells."""
    fields = [
        GridColumn(head, lambda row, index=index: row[index])  # type: ignore[misc]
        for index, head in enumerate(heads)
    ]
    return Grid(fields, rows, width)


def test_columns_are_as_wide_as_the_first_rows() -> None:
    """Columns are as wide as the first rows; numbers are aligned right, texts left."""
    table = grid(
        [ColumnLayout("n", align_right=True), ColumnLayout("name")],
        [["1", "pump"], ["100", "fan"]],
        80,
    )
    assert text_of(table.head()) == "  n name"
    assert text_of(table.line(["7", "fan"])) == "  7 fan "


def test_a_later_number_pushes_its_line() -> None:
    """A number wider than its column is never cut off."""
    table = grid([ColumnLayout("n", align_right=True), ColumnLayout("name")], [["1", "pump"]], 80)
    assert text_of(table.line(["123456", "fan"])) == "123456 fan "


def test_a_text_with_a_limit_is_cut() -> None:
    """A text longer than its column's limit is cut off."""
    table = grid([ColumnLayout("name", max_width=6)], [["a long name"]], 80)
    assert text_of(table.line(["a long name"])) == "a lon…"


def test_shares_fill_the_line() -> None:
    """Room that texts need is distributed by share, to the last column."""
    table = grid(
        [ColumnLayout("a", free_share=1), ColumnLayout("b", free_share=2), ColumnLayout("n")],
        [["x" * 50, "y" * 50, "z"]],
        40,
    )
    assert len(text_of(table.head())) == 40
    assert len(text_of(table.line(["x" * 50, "y" * 50, "z"]))) == 40


def test_only_the_last_column_is_wider_than_its_text() -> None:
    """No blanks between a name and its number on a wide terminal."""
    heads = [ColumnLayout("name", 6, free_share=1), ColumnLayout("n", align_right=True)]
    rows = [["supply temperature", "7"]]
    assert text_of(grid(heads, rows, 100).line(rows[0])) == "supply temperature 7"
    assert text_of(grid(heads, rows, 12).line(rows[0])) == "supply te… 7"


def test_a_narrow_terminal_does_without_columns_that_can_be_spared() -> None:
    """That with the highest number goes first; those without one stay."""
    heads = [
        ColumnLayout("unit", 4),
        ColumnLayout("rate", 5, spare=1),
        ColumnLayout("max", 5, spare=2),
    ]
    rows = [["1", "2", "3"]]
    widths = (16, 15, 10, 9, 3)
    titles = [grid(heads, rows, width).titles for width in widths]
    whole, two, one = ["unit", "rate", "max"], ["unit", "rate"], ["unit"]
    assert titles == [whole, two, two, one, one]
    assert text_of(grid(heads, rows, 10).line(rows[0])) == "1    2    "


def test_a_narrow_terminal_gets_the_least_widths() -> None:
    """On a narrow terminal columns keep their least widths."""
    table = grid([ColumnLayout("name", 8, free_share=1), ColumnLayout("n")], [["a", "1"]], 5)
    assert text_of(table.line(["abcdefghijk", "1"])) == "abcdefg… 1"


def test_a_name_gives_way_and_a_value_is_whole() -> None:
    """Where the terminal has no room, the name is cut first; a value pushes its line instead."""
    heads = [
        ColumnLayout("name", 6, max_width=28, gives_way=True),
        ColumnLayout("value", 5, max_width=10, is_whole=True, gives_way=True),
        ColumnLayout("min", 3, align_right=True),
    ]
    rows = [["supply temperature", "21.5", "3"], ["state", "running at night", "0"]]
    assert text_of(grid(heads, rows, 40).line(rows[0])) == "supply temperature 21.5         3"
    narrow = grid(heads, rows, 20)
    assert text_of(narrow.line(rows[0])) == "supply te… 21.5    3"
    assert text_of(narrow.line(rows[1])) == "state      running at night   0"
