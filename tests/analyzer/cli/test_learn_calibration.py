"""The table of what evidence is worth is the one that was counted.

`python -m tests.support.learn_calibration --check` counts all of it again; here, some parts.
"""

from __future__ import annotations

import json

import pytest

from tests.support.learn_calibration import COUNTS, PARTS, TABLE, counted, table

SOME = ("kinds, seed 21, 10 min", "kinds, seed 22, 60 min", "random devices 501-508")


def test_the_table_holds_the_sums_of_all_parts() -> None:
    """Whoever changes the table counts again."""
    parts = json.loads(COUNTS.read_text())
    assert set(PARTS) <= set(parts)
    assert TABLE.read_text() == table(parts)


@pytest.mark.parametrize("name", SOME)
def test_counts_are_what_learn_says_today(name: str) -> None:
    """Where this fails, `python -m tests.support.learn_calibration` writes the new counts."""
    assert counted(PARTS[name]()) == json.loads(COUNTS.read_text())[name]
