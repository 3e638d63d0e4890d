"""Rows as a list, a selection, a table of a notebook, and as types."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import analyzer
import modlens
from tests.conftest import CAPTURES

DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"


@pytest.fixture
def rows() -> modlens.Rows[modlens.TransactionRow]:
    """The transactions of a recording; there are 35."""
    return modlens.decode(DISTURBED, line="19200-8E1").transactions


@pytest.mark.parametrize(
    ("start", "stop"),
    [(0, 0), (0, 3), (3, None), (None, 3), (-3, None), (None, -33), (-5, -2), (30, 99), (99, None),
     (5, 3), (None, None)],
)  # fmt: skip
def test_a_slice_has_the_rows_that_a_list_has(
    rows: modlens.Rows[modlens.TransactionRow], start: int | None, stop: int | None
) -> None:
    """A list of all numbers, cut by Python, is what comes out."""
    numbers = [row.txn for row in rows]
    assert [row.txn for row in rows[start:stop]] == numbers[start:stop]
    assert len(rows[start:stop]) == len(numbers[start:stop])


def test_steps_are_taken_in_their_order(rows: modlens.Rows[modlens.TransactionRow]) -> None:
    """A filter after a cut sees what the cut left, and the other way round."""
    ok = [row.txn for row in rows if row.status == "ok"]
    assert [row.txn for row in rows.where("ok")[2:4]] == ok[2:4]
    assert [row.txn for row in rows[:10].where("ok")] == [txn for txn in ok if txn <= 10]
    assert [row.txn for row in rows[5:20][3:6]] == [9, 10, 11]


def test_one_row(rows: modlens.Rows[modlens.TransactionRow]) -> None:
    """By its place, from either end; outside there is none."""
    assert (rows[0].txn, rows[34].txn, rows[-35].txn) == (1, 35, 1)
    for place in (35, -36):
        with pytest.raises(IndexError):
            rows[place]
    with pytest.raises(modlens.UsageError, match="no step"):
        rows[::2]


def test_a_selection_gives_tuples(rows: modlens.Rows[modlens.TransactionRow]) -> None:
    """In the order of the selection; unknown columns are reported with the nearest."""
    assert list(rows.select("status", "txn")[:2]) == [(row.status, row.txn) for row in rows[:2]]
    with pytest.raises(modlens.UsageError, match="unit"):
        rows.select("unti")


def test_a_selection_is_what_is_written(
    rows: modlens.Rows[modlens.TransactionRow], tmp_path: Path
) -> None:
    """Columns, filters and cuts reach the file."""
    path = tmp_path / "some.csv"
    assert rows.where("ok").select("txn", "unit")[:2].write(path) == 2
    expected = [f"{row.txn},{row.unit}" for row in rows.where("ok")[:2]]
    assert path.read_text(encoding="utf-8").split() == ["txn,unit", *expected]


def test_other_tables_are_written_and_wrong_names_told(
    rows: modlens.Rows[modlens.TransactionRow], tmp_path: Path
) -> None:
    """The table is that of the rows; what a format cannot hold is an error, and leaves no file."""
    recording = modlens.decode(DISTURBED)
    assert recording.frames.write(tmp_path / "frames.jsonl") == len(recording.frames)
    for name in ("bus.docx", "bus.influx"):
        with pytest.raises(modlens.UsageError):
            recording.findings.write(tmp_path / name)
        assert not (tmp_path / name).exists()
    with pytest.raises(modlens.SourceError, match="directory"):
        rows.write(tmp_path / "no" / "such.csv")


def test_a_notebook_shows_no_markup_of_a_name(tmp_path: Path) -> None:
    """Names come from strangers: they are shown, not run."""
    path = tmp_path / "<script>alert(1)<!--\u202e.hex"
    path.write_bytes(bytes.fromhex("010300000001840a0103020007f986").hex().encode())
    html = modlens.decode(path).transactions._repr_html_()
    assert "<script>" not in html
    assert "\u202e" not in html
    assert "&lt;script&gt;" in html


def test_a_wrong_attribute_is_an_error_for_a_type_checker(tmp_path: Path) -> None:
    """Mypy refuses a column that does not exist, and knows the types of those that do."""
    program = tmp_path / "program.py"
    program.write_text(
        "import modlens\n"
        "for row in modlens.decode('x').transactions:\n"
        "    print(row.unit + 1, row.function_nam)\n"
        "    status: int = row.status\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", str(program)],
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    errors = [line for line in done.stdout.splitlines() if "error" in line]
    assert [line.split(":")[1] for line in errors if "program.py" in line] == ["3", "4"], errors


def test_the_public_package_has_what_analyzer_has() -> None:
    """Nothing but re-exports, and all of them; errors say that they are from modlens."""
    assert set(analyzer.__all__) < set(modlens.__all__)
    for name in (one for one in modlens.__all__ if not one.endswith("Error")):
        assert inspect.getmodule(getattr(modlens, name)) is not modlens
