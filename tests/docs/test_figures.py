"""Figures that several pages quote are those of the tables that commands write."""

from __future__ import annotations

import re
from statistics import median

from tests.docs.documents import text_of

FIGURES, SPEED, MODEL = "docs/figures.md", "docs/speed.md", "docs/segmentation.md"
MISSED, LINES = "frames missed, of 1.37 million", "| line | pauses"
ROUNDED = 0.006
"""Cells have three digits, and so has the mean of two of them."""

Table = dict[str, list[str]]
"""The other cells of each row, by the first one."""


def table(document: str, head: str) -> Table:
    """The table of a document whose first line begins so."""
    _, mark, rest = text_of(document).partition(f"\n{head}")
    assert mark, (document, head)
    lines = f"{head}{rest}".partition("\n\n")[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {name: cells for name, *cells in rows}


def number(text: str) -> float:
    """A number with commas between thousands."""
    return float(text.replace(",", ""))


def quoted(pattern: str) -> list[str]:
    """What the README says, with its lines joined."""
    found = re.search(pattern, " ".join(text_of("README.md").split()))
    assert found, pattern
    return list(found.groups())


def test_the_model_and_the_page_have_one_table_of_accuracy() -> None:
    assert table(FIGURES, LINES) == table(MODEL, LINES)


def test_the_readme_quotes_the_accuracy() -> None:
    """What modlens misses, and the best of the others."""
    *others, own = table(FIGURES, LINES)[MISSED]
    found = quoted(
        r"Of 1\.37 million frames .*? misses ([\d,]+); the next best method misses ([\d,]+)"
    )
    assert found == [own, min(others, key=number)]


def test_the_readme_quotes_the_speed() -> None:
    """That of raw RTU to CSV, beside tshark."""
    _, a_second, _, times = table(FIGURES, "|  | ns a frame")["raw RTU to CSV"]
    found = quoted(r"It decodes (\d+) million frames a second on one core, (\d+) times as many")
    assert found == [f"{number(a_second) / 1e6:.0f}", times]


def test_the_readme_quotes_the_median_and_the_worst_of_all_kinds() -> None:
    """The CSV of twenty kinds of traffic, whose table has its own median and worst."""
    rows = table(SPEED, "| kind of traffic")
    middle, worst = (number(rows[name][1]) for name in ("**median**", "**worst**"))
    found = quoted(
        r"twenty kinds of traffic ([\d.]+) million in the median and ([\d.]+) million at"
    )
    assert found == [f"{1e3 / middle:.0f}", f"{1e3 / worst:.1f}"]


def test_the_best_the_median_and_the_worst_are_those_of_the_rows() -> None:
    """In each column; of the last one the greatest is the best."""
    head, _, *rows = table(SPEED, "| kind of traffic").items()
    kinds = [cells for name, cells in rows if not name.startswith("**")]
    assert len(kinds) == 20
    for at, name in enumerate(head[1]):
        values = sorted(number(cells[at]) for cells in kinds if cells[at])
        if name.startswith("times"):
            values.reverse()
        expected = values[0], median(values), values[-1]
        stated = [number(cells[at]) for _, cells in rows[-3:]]
        for one, other in zip(stated, expected, strict=True):
            assert abs(one - other) <= ROUNDED * other, (name, stated, expected)
