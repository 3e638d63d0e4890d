r"""Tables with a head: any CSV whose columns have names that people use, Kepware's among them.

Also writes the profile's own CSV, which it reads again.

>>> from dissectors.importers.draft import Options
>>> text = "Register;Tag Name;Data Type;Factor;Eng Units\n108;flow;INT16;0,1;l/s\n"
>>> read(text, "map.csv", Options(base=1)).model["registers"]
[{'at': 'hr:107', 'name': 'flow', 'type': 's16', 'scale': 0.1, 'unit': 'l/s'}]
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dissectors.errors import ProfileError
from dissectors.importers.draft import (
    SPACES,
    WIDTHS,
    Draft,
    Imported,
    Options,
    order_of,
    tidy,
)  # fmt: skip
from dissectors.profile import Profile, parse
from dissectors.words import plain

__all__ = ["read", "write"]

_HEADS: Mapping[str, tuple[str, ...]] = {
    "at": ("at",),
    "address": ("address", "register", "reg", "_address", "element", "modbus address", "start",
                "startaddress", "register address", "addr", "register number"),
    "name": ("name", "tag name", "tag", "variable name", "varname", "register name", "point name",
             "variable", "signal"),
    "type": ("type", "data type", "datatype", "format", "sttype", "value type"),
    "table": ("table", "register type", "registertype", "function", "object type", "function code",
              "modbus type"),
    "unit": ("unit", "units", "eng units", "engunits", "uom", "unit of measure",
             "unit of measurement"),
    "scale": ("scale", "factor", "k", "multiplier", "scale factor", "gain"),
    "offset": ("offset", "q", "bias"),
    "order": ("order", "byte order", "byteorder", "word order", "endian", "endianness", "swap"),
    "access": ("access", "rw", "client access", "r/w", "writable", "writeable", "read/write"),
    "count": ("count", "length", "len", "size", "quantity", "registers"),
    "note": ("note", "description", "comment", "notes", "documented name"),
    "group": ("group", "category"),
    "enum": ("enum", "values"),
}  # fmt: skip
_BY_HEAD = {plain(word): key for key, words in _HEADS.items() for word in words}

KEPWARE = ("tagname", "address", "datatype", "clientaccess")
"""Heads by which Kepware's export is known."""

_KINDS: Mapping[str, str] = {
    plain(word): kind
    for kind, words in {
        "bool": ("bool", "boolean", "bit", "digital", "binary"),
        "u16": ("u16", "uint16", "word", "uint", "unsigned", "ushort", "unsigned16", "unsigned int",
                "uint16be", "uint16_t"),
        "s16": ("s16", "int16", "short", "int", "integer", "signed", "signed16", "int16be",
                "int16_t"),
        "u32": ("u32", "uint32", "dword", "udint", "ulong", "unsigned32", "uint32be", "uint32_t"),
        "s32": ("s32", "int32", "long", "dint", "signed32", "int32be", "int32_t"),
        "u64": ("u64", "uint64", "qword", "ulint", "lword", "uint64be"),
        "s64": ("s64", "int64", "llong", "lint", "int64be"),
        "f16": ("f16", "float16", "half"),
        "f32": ("f32", "float", "float32", "real", "single", "floatbe", "float32be"),
        "f64": ("f64", "float64", "double", "lreal", "doublebe"),
        "bcd16": ("bcd16", "bcd"),
        "bcd32": ("bcd32", "lbcd"),
        "u8l": ("u8l", "byte", "uint8", "u8"),
        "s8l": ("s8l", "char", "int8", "s8", "sint"),
        "u8h": ("u8h",),
        "s8h": ("s8h",),
        "str": ("str", "string", "ascii", "text"),
        "raw": ("raw",),
    }.items()
    for word in words
}  # fmt: skip
_SWAPPED = {"floatsw": "f32", "uint32sw": "u32", "int32sw": "s32"}
_FUNCTIONS = {
    "1": "co",
    "2": "di",
    "3": "hr",
    "4": "ir",
    "01": "co",
    "02": "di",
    "03": "hr",
    "04": "ir",
}
_DIGITS = {"0": "co", "1": "di", "3": "ir", "4": "hr"}
_AT = re.compile(
    r"(?:(?P<table>[A-Za-z]+)\s*:?\s*)?(?P<number>0x[0-9A-Fa-f]+|[0-9A-Fa-f]+h|\d+)"
    r"(?:\.(?P<bit>\d+)(?P<half>[HLhl])?)?(?:\s*\[(?P<array>\d+)\])?"
)
_WRITES = ("rw", "r/w", "ro/rw", "write", "readwrite", "read/write", "true", "yes", "1", "w")


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a row stands: table, wire address, bit, length of a text."""

    space: str
    address: int
    bit: int | None
    length: int | None


def read(text: str, name: str, options: Options) -> Imported:
    """The rows of a table; `ProfileError` where no head is understood."""
    text = text.lstrip("\ufeff")
    if re.match(r"(#.*\n)*at\s*[,;\t]", text):
        return Imported(parse(text, name, "csv").model, ())
    rows = list(csv.reader(text.splitlines(keepends=True), delimiter=_delimiter(text)))
    heads = next((number for number, row in enumerate(rows) if _is_head(row)), None)
    if heads is None:
        message = "no line names columns such as Address and Name"
        raise ProfileError(message, path=name, line=1)
    head = [cell.strip() for cell in rows[heads]]
    kepware = all(word in map(plain, head) for word in KEPWARE)
    base, draft = _begin(name, options, kepware=kepware)
    known: dict[str, str] = {}
    for cell in filter(None, head):
        key = _BY_HEAD.get(plain(cell))
        if key is None and not (kepware and plain(cell) in _KEPWARE_ONLY):
            draft.notes.append(f"column {cell!r} is not understood; left out")
        elif key is not None and known.setdefault(key, cell) != cell:
            draft.notes.append(f"column {cell!r} says the same as {known[key]!r}; left out")
    for number, row in enumerate(rows[heads + 1 :], heads + 2):
        cells: dict[str, str] = {}
        for column, cell in zip(head, row, strict=False):
            cells.setdefault(_BY_HEAD.get(plain(column), plain(column)), cell.strip())
        if any(cells.values()) and not row[0].startswith("#"):
            _row(draft, cells, f"line {number}", base, options, kepware=kepware)
    return draft.done()


_KEPWARE_ONLY = {
    "respectdatatype", "scanrate", "scaling", "rawlow", "rawhigh", "scaledlow", "scaledhigh",
    "scaleddatatype", "clamplow", "clamphigh", "negatevalue",
}  # fmt: skip


def _begin(name: str, options: Options, *, kepware: bool) -> tuple[int | str, Draft]:
    draft = Draft({"source": f"table {name}"})
    base: int | str = options.base if options.base is not None else ("modicon" if kepware else 0)
    how = {0: "from 0, as on the wire", 1: "from 1", "modicon": "40001 or 400001"}[base]
    who = "assumed" if options.base is None else "as told"
    draft.notes.append(f"addresses count {how} ({who}; --base 0, 1 or modicon says it)")
    if kepware and options.order is None:
        draft.notes.append(
            "values of several registers: lowest register first, CDAB (assumed; it is a setting of "
            "the device that the file does not have; --order says it)"
        )
    return base, draft


def _row(  # noqa: PLR0913 - what a row is read with
    draft: Draft,
    cells: Mapping[str, str],
    where: str,
    base: int | str,
    options: Options,
    *,
    kepware: bool,
) -> None:
    label = cells.get("name", "")
    place = _place(cells, base)
    if isinstance(place, str):
        draft.notes.append(f"{where}, {label or 'no name'}: {place}; left out")
        return
    word = plain(cells.get("type", ""))
    kind = _KINDS.get(word) or _SWAPPED.get(word)
    if word and kind is None:
        draft.notes.append(f"{where}, {label}: type {cells['type']!r} is not known; left out")
        return
    if place.space in ("co", "di"):
        draft.add(label, place.space, place.address, note=cells.get("note"), access=_access(cells))
        return
    count = place.length or tidy(cells.get("count"))
    kind, bit = _narrow(kind, place, count, kepware=kepware)
    if kind == "str" and count is None:
        draft.notes.append(f"{where}, {label}: a text without a length; left out")
        return
    order = order_of(
        cells.get("order") if plain(cells.get("order", "")) not in _FLAGS else "", where
    )
    order = order or ("CDAB" if word in _SWAPPED or plain(cells.get("order", "")) in _YES else None)
    order = (
        order or options.order or ("CDAB" if kepware and WIDTHS.get(kind or "", 1) > 1 else None)
    )
    scale, offset = _linear(cells, draft, where) if kepware else _scale(cells)
    draft.add(
        label,
        place.space,
        place.address,
        part=None if bit is None else (bit, bit),
        type=None if kind in ("bool", "u16") or bit is not None else kind,
        count=count if kind in ("str", "raw") else None,
        order=None if order == "ABCD" or bit is not None or kind in _NARROW else order,
        scale=scale,
        offset=offset,
        unit=cells.get("unit"),
        access=_access(cells),
        enum=_enum(cells.get("enum", "")),
        group=cells.get("group"),
        note=cells.get("note"),
    )


_NARROW = (None, "bool", "u16", "s16", "str", "u8l", "s8l", "u8h", "s8h")
_FLAGS = {"t", "f", "true", "false", "yes", "no", "1", "0"}
_YES = {"t", "true", "yes", "1"}


def _narrow(
    kind: str | None, place: _Place, count: Any, *, kepware: bool
) -> tuple[str | None, int | None]:
    """The type with the width that a count of registers says, and the bit."""
    if place.bit is not None:
        return "bool", place.bit
    if kind == "bool":
        return "u16", None
    wide = {("u16", 2): "u32", ("s16", 2): "s32", ("u16", 4): "u64", ("s16", 4): "s64"}
    return wide.get((kind or "u16", count), kind), None


def _place(cells: Mapping[str, str], base: int | str) -> _Place | str:
    text = cells.get("address") or cells.get("at") or ""
    match = _AT.fullmatch(text.strip())
    if match is None:
        return f"{text!r} is no address" if text else "no address"
    digits = match["number"]
    number = (
        int(digits.rstrip("hH"), 16)
        if digits.lower().endswith("h")
        else int(digits, 0 if digits.lower().startswith("0x") else 10)
    )
    table = plain(match["table"] or cells.get("table", ""))
    space = SPACES.get(table) or _FUNCTIONS.get(table)
    if table and space is None and not match["table"]:
        return f"table {cells['table']!r} is not known"
    if base == "modicon":
        six = len(digits) == 6  # noqa: PLR2004 - 400001 or 40001
        space = space or _DIGITS.get(digits[0]) if len(digits) >= 5 else space or "co"  # noqa: PLR2004
        wire = number % (100_000 if six else 10_000) - 1 if len(digits) >= 5 else number - 1  # noqa: PLR2004
        if space is None or not 0 <= wire <= 0xFFFF:  # noqa: PLR2004
            return f"{text!r} is no Modicon address"
    else:
        wire = number - int(base)
    length = None
    bit = None if match["bit"] is None else int(match["bit"])
    if match["half"]:
        # 400001.20H: a text of 20 characters, high byte first.
        length, bit = (int(match["bit"]) + 1) // 2, None
    if bit is not None and bit > 15:  # noqa: PLR2004
        return f"bit {bit} is none of 0 to 15"
    return _Place(space or "hr", wire, bit, length)


def _scale(cells: Mapping[str, str]) -> tuple[int | float | None, int | float | None]:
    scale, offset = tidy(cells.get("scale")), tidy(cells.get("offset"))
    return None if scale in (1, 0) else scale, None if offset == 0 else offset


def _linear(
    cells: Mapping[str, str], draft: Draft, where: str
) -> tuple[int | float | None, int | float | None]:
    """Kepware's linear scaling: raw low to high becomes scaled low to high."""
    kind = cells.get("scaling", "").lower()
    if kind in ("", "none"):
        return None, None
    if kind != "linear":
        draft.notes.append(f"{where}: scaling {cells['scaling']!r} is not linear; left out")
        return None, None
    low, high, down, up = (
        tidy(cells.get(key)) for key in ("rawlow", "rawhigh", "scaledlow", "scaledhigh")
    )
    if None in (low, high, down, up) or low == high:
        draft.notes.append(f"{where}: scaling without its four limits; left out")
        return None, None
    scale = (up - down) / (high - low)  # type: ignore[operator]
    if cells.get("negatevalue", "").lower() in ("true", "1"):
        scale, down = -scale, -down  # type: ignore[operator]
    scale, offset = round(scale, 12), round(down - low * scale, 9)  # type: ignore[operator]
    draft.dropped(
        key for key in ("clamplow", "clamphigh") if cells.get(key, "").lower() in ("true", "1")
    )
    return None if scale == 1 else tidy(scale), None if offset == 0 else tidy(offset)


def _access(cells: Mapping[str, str]) -> str | None:
    return "rw" if cells.get("access", "").lower() in _WRITES else None


def _enum(text: str) -> dict[str, str]:
    """`0=off;1=on` or `{"0": "off"}`; anything else is no table of labels."""
    pairs = re.findall(r"[\"']?(-?\d+)[\"']?\s*[=:]\s*[\"']?([^;,\"'}|]+)", text)
    return {key: label.strip() for key, label in pairs}


def _is_head(row: Sequence[str]) -> bool:
    keys = {_BY_HEAD.get(plain(cell)) for cell in row}
    return "address" in keys and len(keys - {None}) > 1


def _delimiter(text: str) -> str:
    lines = [line for line in text.splitlines()[:20] if line.strip()]
    return max(",;\t", key=lambda mark: sum(line.count(mark) for line in lines))


KEYS = (
    "at", "name", "type", "count", "order", "scale", "offset", "sf", "unit", "access", "enum",
    "bits", "nan", "group", "note",
)  # fmt: skip


def write(profile: Profile) -> tuple[str, list[str]]:
    """The profile's own CSV; nothing is lost."""
    out = _Text()
    for key, value in profile.device.items():
        out.write(f"#{'base' if key == 'address_base' else key}={_cell(value)}\n")
    used = [key for key in KEYS if any(key in point for point in profile.points)]
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(used)
    for point in profile.points:
        writer.writerow([_cell(point.get(key, "")) for key in used])
    return "".join(out.parts), []


class _Text:
    """What a csv.writer writes to."""

    def __init__(self) -> None:
        self.parts: list[str] = []

    def write(self, part: str) -> None:
        """Keep it."""
        self.parts.append(part)


def _cell(value: Any) -> str:
    if isinstance(value, Mapping):
        return ";".join(f"{key}={text}" for key, text in value.items())
    return ";".join(map(str, value)) if isinstance(value, list) else str(value)
