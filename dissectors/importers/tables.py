"""Finds the table in a text: delimiter, header line, the key of each column, rows."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from dissectors.errors import ProfileError
from dissectors.function_lookup import normalized
from dissectors.importers.profile_builder import SPACES
from dissectors.importers.table_headers import HEADER_WORDS, KEY_OF_HEADER, Preset, preset_of

__all__ = ["FoundTable", "find_table"]

_DELIMITERS = ",;\t|"

_DIGITS = re.compile(r"(?=\b[0-9A-Fa-f]+(?:\b|_))(?!0[xX])(?![0-9A-Fa-f]*[hH]\b)")
"""The position before a hexadecimal number that has no `0x` or `h`."""

_MAX_HEADER_LINE = 500
"""Lines among which the header line is searched."""


@dataclass(frozen=True, slots=True)
class FoundTable:
    """A table: its rows by key with their line numbers, its preset, notes on what is left out."""

    rows: Sequence[tuple[int, Mapping[str, str]]]
    preset: Preset | None
    notes: Sequence[str]


def find_table(text: str, name: str) -> FoundTable:
    """Find the table in a text, with the delimiter by which most columns are known.

    `ProfileError` where no line is a head, or quotation marks are left open.
    """
    delimiter = max(
        _DELIMITERS,
        key=lambda delimiter: max(
            (_count_known_columns(row) for row in _cells_ignoring_quotes(text, delimiter)),
            default=0,
        ),
    )
    records = list(_records(text, delimiter, name))
    at = next(
        (
            number
            for number, (_, row) in enumerate(records[:_MAX_HEADER_LINE])
            if _count_known_columns(row)
        ),
        None,
    )
    if at is None:
        first = next((line.strip() for line in text.splitlines() if line.strip()), "")
        raise ProfileError(
            "no line names the columns: an address (Address, Register, ...) and another one (Name, "
            f"Type, ...); the file begins with {first[:60]!r}",
            path=name,
            line=1,
        )
    head = records[at][1]
    body = [(line, row) for line, row in records[at + 1 :] if not row[:1] or row[0][:1] != "#"]
    preset = preset_of(head)
    keys, notes = _keys(head, [row for _, row in body], preset)
    rows = []
    for line, row in body:
        if any(row[len(head) :]):
            notes.append(
                f"line {line}: {len(row)} cells, but {len(head)} columns; skipped (a decimal "
                "comma, or a text without quotation marks?)"
            )
        elif any(row):
            cells = {key: cell for key, cell in zip(keys, row, strict=False) if key}
            rows.append((line, cells))
    if "address" in keys and "hex" in head[keys.index("address")].lower():
        notes.append("addresses are hexadecimal, as the header says")
        rows = [(line, _hexadecimal(cells)) for line, cells in rows]
    return FoundTable(rows, preset, notes)


def _hexadecimal(cells: Mapping[str, str]) -> dict[str, str]:
    return {**cells, "address": _DIGITS.sub("0x", cells.get("address", ""), count=1)}


def _cells_ignoring_quotes(text: str, delimiter: str) -> Iterator[list[str]]:
    """The cells of each line, without regard to quotation marks."""
    return (line.replace('"', "").split(delimiter) for line in text.splitlines()[:_MAX_HEADER_LINE])


def _records(text: str, delimiter: str, name: str) -> Iterator[tuple[int, list[str]]]:
    """The first line number and the cells of each record."""
    reader = csv.reader(text.splitlines(keepends=True), delimiter=delimiter, strict=True)
    line = 1
    try:
        for row in reader:
            yield line, [cell.strip() for cell in row]
            line = reader.line_num + 1
    except csv.Error as error:
        message = f"not CSV from here on: {error}; check the quotation marks"
        raise ProfileError(message, path=name, line=line) from None


def _header_words(words: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Key -> words for its column; in tables without an address, an offset is the address."""
    header_words = dict(HEADER_WORDS)
    if not set(header_words["address"]) & set(words):
        header_words["address"], header_words["offset"] = (*header_words["address"], "offset"), ()
    return header_words


def _normalized_header(cell: str) -> str:
    """A normalized column title, without text in brackets if that makes it a known one.

    >>> [_normalized_header(cell) for cell in ("Modbus Address", "Address (wire)", "Scale (of 1)")]
    ['modbusaddress', 'address', 'scale']
    """
    word, bare = normalized(cell), normalized(re.sub(r"[(\[].*?[)\]]", "", cell))
    return bare if word not in KEY_OF_HEADER and bare in KEY_OF_HEADER else word


def _count_known_columns(row: Sequence[str]) -> int:
    """How many cells of a line are known column titles; 0 where it cannot be the header line."""
    keys = {KEY_OF_HEADER.get(_normalized_header(cell)) for cell in row} - {None}
    return len(keys) if keys & {"address", "offset"} and len(keys) > 1 else 0


def _keys(
    head: Sequence[str], rows: Sequence[Sequence[str]], preset: Preset | None
) -> tuple[list[str], list[str]]:
    """The key of each column, empty for those that are left out, and notes on these."""
    words = [_normalized_header(cell) for cell in head]
    keys, notes = [""] * len(head), []
    for key, names in _header_words(words).items():
        columns = [at for name in names for at, word in enumerate(words) if word == name]
        if key == "type" and len(columns) > 1:
            # Some tables have both TYPE and FORMAT: one names the table, the other the data type.
            tables = [at for at in columns if _says_tables(row[at : at + 1] for row in rows)][:1]
            columns = [at for at in columns if at not in tables]
            for at in tables:
                keys[at] = "table"
        for at in columns[:1]:
            keys[at] = key
        for at in columns[1:]:
            first = head[columns[0]]
            notes.append(f"column {head[at]!r} has the same meaning as {first!r}; skipped")
    if "name" not in keys and "note" in keys:
        at = keys.index("note")
        keys[at] = "name"
        notes.append(f"no column has the names: those of {head[at]!r} are taken")
    for at, word in enumerate(words):
        filled = any(cell for row in rows for cell in row[at : at + 1])
        if preset and word in preset.ignored_columns:
            notes.append(f"column {head[at]!r} cannot be kept in a profile; skipped")
        elif word not in KEY_OF_HEADER and (filled or head[at]):
            notes.append(f"column {head[at] or at + 1!r} is not understood; skipped")
    return keys, notes


def _says_tables(cells: Iterable[Sequence[str]]) -> bool:
    words = {normalized(cell) for row in cells for cell in row if cell}
    return bool(words) and words <= set(SPACES)
