r"""Tables with a header line: any CSV with common column names, Kepware's among them.

Also writes the profile's own CSV, which it reads again.

>>> from dissectors.importers.profile_builder import Options
>>> text = "Register;Tag Name;Data Type;Factor;Eng Units\n108;flow;INT16;0,1;l/s\n"
>>> read(text, "map.csv", Options(base=1)).model["registers"]
[{'at': 'hr:107', 'name': 'flow', 'type': 's16', 'scale': 0.1, 'unit': 'l/s'}]
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

from dissectors.importers.profile_builder import (
    Imported,
    Options,
    ProfileBuilder,
    choose_unit,
    parse_decimal,
)
from dissectors.importers.rows import NO_PRESET, RowConverter
from dissectors.importers.tables import find_table
from dissectors.profile import Profile, parse

__all__ = ["read", "write"]


def read(text: str, name: str, options: Options) -> Imported:
    """Read a table; `ProfileError` where no line is a header."""
    text = text.lstrip("\ufeff")
    if _is_own(text):
        return _read_own_csv(text, name, options)
    found = find_table(text, name)
    preset = found.preset or NO_PRESET
    builder = ProfileBuilder({"source": f"table {name}"}, options.order or preset.order)
    base = options.base if options.base is not None else preset.base
    if preset is not NO_PRESET:
        builder.notes.append(f"a table of {preset.title}")
    _note_assumptions(builder, base, options)
    builder.notes += found.notes
    unit = choose_unit((_unit(cells) for _, cells in found.rows), options.unit, name)
    words = name.rpartition("/")[2] if preset.table_in_file_name else ""
    table = "ir" if "input" in words else "hr" if "holding" in words else None
    rows = RowConverter(builder, base, preset, table)
    for line, cells in found.rows:
        if _unit(cells) in (None, unit):
            rows.add(_titled(cells), f"line {line}")
    if options.base is None and base != "modicon":
        _note_manual_numbers(builder, [cells.get("address", "") for _, cells in found.rows])
    return builder.build()


def _is_own(text: str) -> bool:
    """Whether the first line that is no setting names `at`, as the profile's own CSV does."""
    lines = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    cells = next(lines, "").replace(";", ",").replace("\t", ",").split(",")
    return "at" in [cell.strip().strip('"').lower() for cell in cells]


def _read_own_csv(text: str, name: str, options: Options) -> Imported:
    given = {"--base": options.base, "--order": options.order, "--unit": options.unit}
    notes = [
        f"{option} is ignored: a profile in CSV states it itself"
        for option, value in given.items()
        if value is not None
    ]
    return Imported(parse(text, name, "csv").model, tuple(notes))


def _titled(cells: Mapping[str, str]) -> Mapping[str, str]:
    """A row whose title is the name where it has no other, and else the note."""
    title = cells.get("title", "")
    if not title:
        return cells
    if not cells.get("name"):
        note = "" if cells.get("note") == title else cells.get("note", "")
        return {**cells, "name": title, "note": note}
    return {**cells, "note": cells.get("note") or title}


def _unit(cells: Mapping[str, str]) -> int | None:
    unit = parse_decimal(cells.get("slave"))
    return unit if isinstance(unit, int) else None


def _note_assumptions(builder: ProfileBuilder, base: int | str, options: Options) -> None:
    """Add notes on what is assumed because the file does not say it."""
    how = {0: "from 0, as on the wire", 1: "from 1", "modicon": "40001 or 400001"}[base]
    who = "assumed" if options.base is None else "as given"
    builder.notes.append(f"addresses count {how} ({who}; --base 0, 1 or modicon overrides)")
    if options.order is None and builder.order:
        builder.notes.append(
            f"values of several registers: lowest register first, {builder.order} (assumed; it is "
            "a setting of the device that the file does not have; --order overrides it)"
        )


def _note_manual_numbers(builder: ProfileBuilder, addresses: Sequence[str]) -> None:
    """Add a note if all addresses look like the numbers of a manual, such as 40001 or 300101.

    A wire address may look so as well, which is why they are not taken for that.
    """
    numbers = [text.strip() for text in addresses if text.strip()]
    if numbers and all(map(_MANUAL_NUMBER.fullmatch, numbers)):
        builder.notes.append(
            f"{numbers[0]} and the others look like the numbers of a manual (40001 is the first"
            " holding register): give --base modicon if they are"
        )


_MANUAL_NUMBER = re.compile(r"[134](?!0+$)(?:\d{4}|[0-6]\d{4})")

KEYS = (
    "at", "name", "type", "count", "order", "scale", "offset", "sf", "unit", "access", "enum",
    "bits", "nan", "group", "note",
)  # fmt: skip


def write(profile: Profile) -> tuple[str, list[str]]:
    """Write a profile as its own CSV; a text that a cell cannot hold is altered, with a note."""
    notes: list[str] = []
    out = io.StringIO()
    for key, value in profile.device.items():
        cell = _cell(value, f"device.{key}", notes)
        plain = " ".join(cell.splitlines())
        if plain != cell:
            notes.append(f"device.{key}: written on one line")
        # Readers drop commas at the end of a setting, because spreadsheets pad short lines with
        # them.
        if plain != plain.rstrip(","):
            notes.append(f"device.{key}: written without the commas at its end")
            plain = plain.rstrip(",")
        out.write(f"#{'base' if key == 'address_base' else key}={plain}\n")
    used = [key for key in KEYS if any(key in point for point in profile.points)]
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(used)
    for point in profile.points:
        name = point["name"]
        writer.writerow([_cell(point.get(key, ""), f"{name}.{key}", notes) for key in used])
    return out.getvalue(), notes


def _cell(value: Any, what: str, notes: list[str]) -> str:
    """A value as one cell, which is no formula to a spreadsheet and controls no terminal."""
    text = _text(value, what, notes)
    plain = _CONTROL.sub("?", text)
    if plain != text:
        notes.append(f"{what}: written without its control characters")
    # Readers take one apostrophe away again.
    return f"'{plain}" if isinstance(value, str | Mapping) and _FORMULA.match(plain) else plain


_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
_FORMULA = re.compile(r"'*[=+\-@]")


def _text(value: Any, what: str, notes: list[str]) -> str:
    """A value as one cell; lists are joined by semicolons, which their items cannot have."""
    if not isinstance(value, Mapping | list):
        text = str(value)
        if text != text.strip():
            notes.append(f"{what}: written without the spaces at its ends")
        return text.strip()
    texts = list(value.values()) if isinstance(value, Mapping) else value
    parts = ["nan" if text is None else str(text).replace(";", ",").strip() for text in texts]
    if parts != ["nan" if text is None else str(text) for text in texts]:
        notes.append(
            f"{what}: written with commas instead of semicolons, without spaces at the ends"
        )
    if isinstance(value, Mapping):
        return ";".join(f"{key}={part}" for key, part in zip(value, parts, strict=True))
    return ";".join(parts)
