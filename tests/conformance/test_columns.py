"""Every column of columns.toml is in the core's tables, in order, everywhere."""

from __future__ import annotations

import tomllib

import pytest

from analyzer import decode
from analyzer.columns import TABLES, columns
from tests.conftest import CAPTURES, ROOT, recording_with
from tests.support import row_types

PATH = ROOT / "analyzer" / "columns.toml"
TYPES = ("int", "us", "time", "float", "bool", "text", "hex", "ints", "texts", "map")
RESERVED = {"transaction", "table", "values", "offset", "check", "order", "group", "index", "to"}


@pytest.fixture(scope="module")
def written() -> dict[str, list[dict[str, str]]]:
    """What columns.toml says."""
    found = tomllib.loads(PATH.read_text(encoding="utf-8"))
    return {name: rows for name, rows in found.items() if name != "version"}


def test_the_tables_are_those_of_the_file(written: dict[str, list[dict[str, str]]]) -> None:
    """The core has exactly the tables of columns.toml."""
    assert set(written) == set(TABLES)


@pytest.mark.parametrize("table", TABLES)
def test_the_core_has_the_columns_of_the_file(
    table: str, written: dict[str, list[dict[str, str]]]
) -> None:
    """Read back, in rows, and in CSV: the same keys in the same order."""
    keys = [row["key"] for row in written[table]]
    assert [column.key for column in columns(table)] == keys
    recording = decode(recording_with(table))
    found = next(getattr(recording, table).tables())
    assert found.name == table
    assert list(found[0].as_dict()) == keys
    text = next(found.lines("csv", keys, header=True))
    assert text.split(b"\r\n", 1)[0].decode().split(",") == keys


@pytest.mark.parametrize("table", TABLES)
def test_columns_have_known_types_and_free_names(
    table: str, written: dict[str, list[dict[str, str]]]
) -> None:
    """Columns have known types, and names that databases do not margin."""
    for row in written[table]:
        assert row["type"] in TYPES
        assert row["key"] not in RESERVED


@pytest.mark.parametrize("table", TABLES)
def test_cells_have_the_type_of_their_column(table: str) -> None:
    """Cells have the Python type of their column."""
    python = {
        "int": "int", "us": "float", "float": "float", "time": "datetime", "bool": "bool",
        "text": "str", "hex": "bytes", "ints": "list", "texts": "list", "map": "dict",
    }  # fmt: skip
    kinds = {column.key: python[column.type] for column in columns(table)}
    path = CAPTURES / "pymodbus_all_functions" / "recording.jsonl"
    path = recording_with(table) if table == "connections" else path
    for row in getattr(decode(path, line="19200-8E1"), table):
        for key, value in row.as_dict().items():
            assert value is None or type(value).__name__ == kinds[key], (key, value)


def test_the_typed_rows_are_those_of_the_columns() -> None:
    """`python -m tests.support.row_types` writes the module again."""
    assert row_types.PATH.read_text(encoding="utf-8") == row_types.row_types()


@pytest.mark.parametrize("table", TABLES)
def test_a_column_that_always_has_a_value_is_never_empty(table: str) -> None:
    """In every recording of the project."""
    always = [column.key for column in columns(table) if column.always]
    for path in sorted(CAPTURES.glob("*/recording.*")):
        for row in decode(path).table(table):
            assert None not in [getattr(row, key) for key in always], (path, row)
