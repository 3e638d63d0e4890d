"""Writes the typed rows, `analyzer/row_types.py`, from the columns.

`python -m tests.support.row_types` writes the file; a conformance test compares it.
"""

from __future__ import annotations

import tomllib

from analyzer.columns import TABLES, columns
from tests.conftest import ROOT

__all__ = ["PATH", "row_types"]

PATH = ROOT / "analyzer" / "row_types.py"

PYTHON_TYPES = {
    "int": "int",
    "us": "float",
    "time": "datetime",
    "float": "float",
    "bool": "bool",
    "text": "str",
    "hex": "bytes",
    "ints": "list[int]",
    "texts": "list[str]",
    "map": "dict[str, Any]",
}

HEAD = '''\
"""The rows of each table as types, so that a checker refuses a column that does not exist.

Generated from columns.toml (`python -m tests.support.row_types`). A row is a `_modlens.Row`: these
classes only say which attributes it has. A column that may be empty has `| Any` in its type: it is
None then, and a checker does not ask for a test, because filters usually exclude that. Names that
end in `_us` are microseconds.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any, Protocol

'''


def row_types() -> str:
    """The text of the module."""
    names = {table: f"{_singular(table).capitalize()}Row" for table in TABLES}
    listed = "".join(f'    "{name}",\n' for name in sorted([*names.values(), "AnyRow"]))
    parts = [HEAD, f"__all__ = [\n{listed}]\n", _common()]
    parts += [_row(table, name) for table, name in names.items()]
    return "".join(parts)


def _singular(table: str) -> str:
    return "diagnosis" if table == "diagnoses" else table.removesuffix("s")


def _common() -> str:
    return '''

class AnyRow(Protocol):
    """A row of any table."""

    def as_dict(self) -> dict[str, Any]:
        """Column -> value, in the table's order."""
'''


def _row(table: str, name: str) -> str:
    lines = [f'\n\nclass {name}(AnyRow, Protocol):\n    """A row of the table `{table}`."""\n']
    for column in columns(table):
        kind = PYTHON_TYPES[column.type] + ("" if column.always else " | Any")
        lines.append(f"\n    @property\n    def {column.key}(self) -> {kind}:\n")
        text = _sentence(column.help)
        lines.append(_docstring(text))
    return "".join(lines)


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _docstring(text: str) -> str:
    """One line where it fits into a hundred columns; otherwise its first half in front."""
    line = f'        """{text}"""\n'
    if len(line) <= 101:
        return line
    cut = max(text.rfind(mark, 0, 85) for mark in ("; ", ": ", ", "))
    head, rest = text[:cut], text[cut + 2 :]
    words, rows, row = rest.split(" "), [], ""
    for word in words:
        if len(row) + len(word) + 1 > 90:
            rows.append(row)
            row = ""
        row = f"{row} {word}".strip()
    rows.append(row)
    body = "".join(f"        {one}\n" for one in rows)
    return f'        """{head}.\n\n{body}        """\n'


def _installed_are_those_of_the_file() -> bool:
    """Whether the extension was built since the last change of the columns."""
    tables = tomllib.loads((ROOT / "analyzer" / "columns.toml").read_text(encoding="utf-8"))
    return all(
        [one.key for one in columns(table)] == [one["key"] for one in tables[table]]
        for table in TABLES
    )


if __name__ == "__main__":
    if not _installed_are_those_of_the_file():
        raise SystemExit(
            "analyzer/columns.toml has other columns than what is installed; run `make demo` first"
        )
    PATH.write_text(row_types(), encoding="utf-8")
