"""Workbooks as another library reads them, and the CSV that Excel understands."""

from __future__ import annotations

import csv
import io
import tempfile
from datetime import datetime
from pathlib import Path
from typing import Any

import openpyxl
import pytest

import modlens
from analyzer.columns import TABLES, columns
from analyzer.exports import ExportOptions, xlsx
from analyzer.exports.sink import ExportSink, Target
from tests.conftest import CAPTURES

DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
RECORDINGS = ("pymodbus_all_functions", "pymodbus_disturbed", "pymodbus_tcp")


def sheet(path: Path, number: int = 0) -> list[tuple[Any, ...]]:
    return list(openpyxl.load_workbook(path).worksheets[number].iter_rows(values_only=True))


def as_excel(kind: str, value: Any) -> Any:
    """A cell of the API in the types that a workbook has."""
    if value is None or value in ([], ""):
        return None
    if kind == "time":
        return value.replace(tzinfo=None)
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, list):
        return " ".join(map(str, value))
    return value


@pytest.mark.parametrize("recording", RECORDINGS)
@pytest.mark.parametrize("table", TABLES)
def test_every_cell_is_there_with_its_type(recording: str, table: str, tmp_path: Path) -> None:
    path = next((CAPTURES / recording).glob("recording.*"))
    rows = modlens.decode(path, line="19200-8E1").table(table)
    assert rows.write(tmp_path / "log.xlsx") == len(rows)
    head, *lines = sheet(tmp_path / "log.xlsx")
    assert head == rows.columns
    kinds = {column.key: column.type for column in columns(table)}
    for line, row in zip(lines, rows, strict=True):
        for key, cell in zip(head, line, strict=True):
            value = as_excel(kinds[key], getattr(row, key))
            if isinstance(value, datetime):
                assert abs((cell - value).total_seconds()) < 2e-3
            elif isinstance(value, float):
                assert cell == pytest.approx(value)  # Excel's numbers have 16 digits.
            elif kinds[key] != "map":
                assert cell == value, key
    assert [line[0] for line in sheet(tmp_path / "log.xlsx", 1)] == ["column", *head]


def put(rows: list[tuple[Any, ...]], path: Path, most: int = xlsx.MAX_LINES) -> xlsx.Format:
    """Writes findings with these numbers and details."""
    form = xlsx.Format(ExportOptions("findings", ("frame", "detail")))
    form._max_lines = most
    output = form.output(str(path), growing=False)

    class Table:
        def __len__(self) -> int:
            return len(rows)

        def tuples(self, _keys: object, start: int, count: int) -> list[tuple[Any, ...]]:
            return rows[start : start + count]

    form.encode(Table())  # type: ignore[arg-type]
    output.append(form.footer())
    output.close()
    return form


def test_rows_go_on_in_a_second_sheet(tmp_path: Path) -> None:
    form = put([(number, "x") for number in range(25)], tmp_path / "a.xlsx", 11)
    book = openpyxl.load_workbook(tmp_path / "a.xlsx")
    assert book.sheetnames == ["findings", "findings 2", "findings 3", "columns"]
    found = [line[0] for number in range(3) for line in sheet(tmp_path / "a.xlsx", number)[1:]]
    assert found == list(range(25))
    assert form.closing_remark() == "3 sheets, since Excel has 1,048,576 lines in one"


def test_no_text_becomes_a_formula_and_a_long_one_is_cut(tmp_path: Path) -> None:
    texts = ["=1+1", "+1", "-1", "@SUM(A1)", "http://example.org", "\x01\x00", "x" * 40_000]
    form = put(list(enumerate(texts)), tmp_path / "a.xlsx")
    cells = list(openpyxl.load_workbook(tmp_path / "a.xlsx").worksheets[0].iter_rows(min_row=2))
    assert {cell.data_type for _, cell in cells} == {"s"}
    assert [cell.value for _, cell in cells][:5] == texts[:5]
    assert not any(cell.hyperlink for _, cell in cells)
    assert len(cells[-1][1].value) == 32_767
    assert form.closing_remark() == "1 cells cut at Excel's 32,767 characters"


def test_the_bytes_are_the_same_each_time(tmp_path: Path) -> None:
    rows = modlens.decode(DISTURBED, line="19200-8E1").findings
    rows.write(tmp_path / "a.xlsx")
    rows.write(tmp_path / "b.xlsx")
    assert (tmp_path / "a.xlsx").read_bytes() == (tmp_path / "b.xlsx").read_bytes()


def test_an_abandoned_workbook_leaves_no_temporary_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    target = Target("frames", "xlsx", str(tmp_path / "a.xlsx"))
    sink = ExportSink(target, columns=None, where=None, growing=False)
    for batch in modlens.decode(DISTURBED).batches("frames"):
        sink.put(batch)
    assert list(tmp_path.iterdir())
    sink.rollback()
    assert list(tmp_path.iterdir()) == []


def test_csv_for_excel_has_times_that_it_reads(tmp_path: Path) -> None:
    rows = modlens.decode(DISTURBED, line="19200-8E1").findings
    rows.write(tmp_path / "a.csv", style="excel")
    rows.write(tmp_path / "b.csv")
    data = (tmp_path / "a.csv").read_bytes()
    assert data.startswith(b"\xef\xbb\xbf")
    found = list(csv.reader(io.StringIO(data.decode("utf-8-sig"), newline="")))
    plain = list(csv.reader(io.StringIO((tmp_path / "b.csv").read_text("utf-8"), newline="")))
    at = found[0].index("time")
    for row, other in zip(found[1:], plain[1:], strict=True):
        time = datetime.strptime(row[at], "%Y-%m-%d %H:%M:%S.%f").isoformat()
        assert other[at].startswith(time[:23])
        assert row[:at] + row[at + 1 :] == other[:at] + other[at + 1 :]
