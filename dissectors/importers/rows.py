"""Converts rows of a table to points: address, type, and the other keys.

Whatever a profile cannot hold becomes a note with its line.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dissectors.function_lookup import normalized, parse_number
from dissectors.importers.cells import RowCells
from dissectors.importers.profile_builder import (
    REGISTERS_OF_TYPE,
    SPACES,
    NotConvertible,
    ProfileBuilder,
    parse_decimal,
)
from dissectors.importers.table_headers import (
    ORDER_SUFFIXES,
    TABLE_OF_FUNCTION,
    TYPE_NAMES,
    TYPES_WITHOUT_WIDTH,
    Preset,
)

__all__ = ["NO_PRESET", "RowConverter"]

NO_PRESET = Preset("plain", ())
"""The properties of a table of no particular program."""

_ADDRESS = re.compile(
    r"(?:(?P<table>[a-z]+)\s*:?\s*|(?P<digit>[134])x)?"
    r"(?P<number>0x[0-9a-f]{1,9}|[0-9][0-9a-f]{0,9}h|\d{1,9})"
    r"(?:\s*[-\u2013~]\s*(?P<last>\d{1,9})|\.b?(?P<bit>\d{1,5})(?P<text>[HL])?|\.(?P<half>lo|hi))?"
    r"(?P<array>(?:\s*\[\d{1,5}\])*)",
    re.IGNORECASE,
)
_BITS_OF_REGISTER = re.compile(r"\s*([1-9]|1[0-5])\s*bits?\s*", re.IGNORECASE)
"""A type such as `4bit`: so many bits of a register, from the bit of its address on."""

_DIGITS = {"0": "co", "1": "di", "3": "ir", "4": "hr"}
_LAST = 0xFFFF
_BITS = 16


@dataclass(frozen=True, slots=True)
class _RowAddress:
    """The address of a row; `registers` is the length that the address itself states."""

    space: str
    address: int
    bit: int | None
    registers: int | None
    elements: int | None
    half: str
    order: str | None


@dataclass(frozen=True, slots=True)
class _RowType:
    """The type of a row: its name, order, registers of a text, whether it states its width."""

    word: str | None
    order: str | None = None
    registers: int | None = None
    has_width: bool = True


@dataclass(frozen=True, slots=True)
class RowConverter:
    """Adds the rows of one table to a builder."""

    builder: ProfileBuilder
    base: int | str
    preset: Preset = NO_PRESET
    table: str | None = None
    """The table of rows that do not say theirs, where the file's name says it."""

    def add(self, row: Mapping[str, str], where: str) -> None:
        """Add a row, given as its cells by key; `where` is its line."""
        self.builder.where = f"{where}, "
        access = row.get("access", "")
        row = {**row, "access": self.preset.access.get(normalized(access), access)}
        cells = RowCells(row, f"{where}, {row.get('name') or 'no name'}", self.builder)
        try:
            self._add(cells)
        except NotConvertible as reason:
            cells.note(f"{reason}; skipped")

    def _add(self, cells: RowCells) -> None:
        """Add the point of a row; `NotConvertible` says why that is not possible."""
        place, kind = self._place(cells), self._kind(cells.get("type"))
        keys: dict[str, Any] = {key: cells.get(key) for key in ("unit", "group", "note")}
        keys["access"], keys["enum"], keys["nan"] = (
            cells.access(),
            cells.labels(),
            cells.sentinels(),
        )
        keys["scale"], keys["offset"] = cells.scale_and_offset()
        # "0.1V": the scale is before the unit, or alone where the value has none.
        scaled = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([^\d.\s].*)?", cells.get("unit"))
        if self.preset.scaled_units and scaled:
            keys["scale"], keys["unit"] = parse_decimal(scaled[1]), scaled[2] or ""
        if place.space in ("co", "di"):
            count = parse_decimal(cells.get("count") or cells.get("length")) or place.elements
            if kind.word not in (None, "bool"):
                cells.note(f"a coil is a bool, not {cells.get('type')!r}")
            keys["count"] = count if isinstance(count, int) and count > 1 else None
            self.builder.add(cells.get("name"), place.space, place.address, **keys)
            return
        width = self._bit_count(cells.get("type"))
        if width:
            low = place.bit or 0
            part = (low, low + width - 1)
            self.builder.add(cells.get("name"), place.space, place.address, part=part, **keys)
            return
        word, count = self._type_and_count(kind, place, cells)
        order = cells.order() or place.order or kind.order
        stated_order = order or cells.get("order") or cells.get("words") or self.builder.order
        if not stated_order and REGISTERS_OF_TYPE.get(word or "u16", 1) > 1:
            self.builder.note_once(
                "values of several registers: highest register first, ABCD (assumed; --order "
                "overrides it)"
            )
        self.builder.add(
            cells.get("name"),
            place.space,
            place.address,
            part=None if place.bit is None else (place.bit, place.bit),
            type=None if word in ("bool", "u16") else word,
            count=count,
            order=order,
            **keys,
        )

    def _place(self, cells: RowCells) -> _RowAddress:
        """The address of a row: table, wire address, and what follows the number."""
        text = cells.get("address")
        match = _ADDRESS.fullmatch(text.strip())
        if match is None:
            raise NotConvertible(f"{text!r} is not an address" if text else "no address")
        digits = match["number"].lower()
        stated_space = self._table(match, cells)
        address = parse_number(digits) or 0
        if self.base == "modicon":
            space, wire = _modicon(digits, stated_space or _DIGITS.get(match["digit"] or ""), text)
        else:
            space = stated_space or _DIGITS.get(match["digit"] or "")
            wire = address - int(self.base)
        space = space or self.table
        if space is None:
            self.builder.note_once("no column names the table: holding registers (assumed)")
        if not 0 <= wire <= _LAST:
            raise NotConvertible(f"{text!r} is not an address where counting starts at {self.base}")
        registers, bit, order = self._part(match, address)
        sizes = [int(size) for size in re.findall(r"\d+", match["array"])]
        elements = math.prod(sizes) if sizes else None
        half = (match["half"] or "").lower()
        return _RowAddress(space or "hr", wire, bit, registers, elements, half, order)

    def _part(
        self, match: re.Match[str], address: int
    ) -> tuple[int | None, int | None, str | None]:
        """What follows the number of an address: registers of a text or range, a bit, an order."""
        if match["text"]:
            # Kepware: 400001.20H is a text of 20 characters, the high byte first.
            return (int(match["bit"]) + 1) // 2, None, "BADC" if match["text"] in "Ll" else None
        if match["bit"]:
            first = self.preset.first_bit
            bit = int(match["bit"]) - first
            if not 0 <= bit < _BITS:
                raise NotConvertible(
                    f"bit {match['bit']} is not one of {first} to {first + _BITS - 1}"
                )
            return None, bit, None
        if match["last"]:
            registers = int(match["last"]) - address + 1
            if registers < 1:
                raise NotConvertible(f"{match[0]!r} ends before it begins")
            return registers, None, None
        return None, None, None

    def _table(self, match: re.Match[str], cells: RowCells) -> str | None:
        """The table (hr, ir, co, di) from the address, the table column, or the function code."""
        if match["table"]:
            space = SPACES.get(normalized(match["table"]))
            if space is None or (
                self.preset.base == "modicon" and normalized(match["table"]) == "h"
            ):
                raise NotConvertible(f"{match[0]!r}: {match['table']!r} is not a known table")
            return space
        table, function = cells.get("table"), cells.get("function")
        if table and not table.isdigit():
            space = SPACES.get(normalized(table))
        elif table or function:
            if table:
                self.builder.note_once("numbers that name tables are function codes (assumed)")
            code = re.search(r"0x[0-9a-f]+|\d+", table or function, re.IGNORECASE)
            space = (
                SPACES.get(normalized(function))
                if code is None
                else TABLE_OF_FUNCTION.get(parse_number(code[0]) or 0)
            )
        else:
            return None
        if space is None:
            raise NotConvertible(f"table {table or function!r} is not known")
        return space

    def _bit_count(self, text: str) -> int:
        """How many bits of a register a type takes; 0 where it takes whole ones."""
        bits = _BITS_OF_REGISTER.fullmatch(text)
        return int(bits[1]) if bits else self.preset.bit_types.get(normalized(text), 0)

    def _kind(self, text: str) -> _RowType:
        """The type that a cell names, with order or length where the name states it."""
        word = normalized(text)
        if not word:
            return _RowType(None, has_width=False)
        sized = re.fullmatch(r"\s*(\w+)\s*[\[(]\s*(\d+)\s*[\])]\s*", text)
        if sized and (
            TYPE_NAMES.get(normalized(sized[1])) == "str" or normalized(sized[1]) == "char"
        ):
            return _RowType("str", registers=(int(sized[2]) + 1) // 2)
        word = word.removesuffix("array")
        own = self.preset.types.get(word)
        if self._bit_count(text):
            return _RowType("u16")
        if own or word in TYPE_NAMES:
            return _RowType(
                own or TYPE_NAMES[word], has_width=bool(own) or word not in TYPES_WITHOUT_WIDTH
            )
        if word[-2:] in ORDER_SUFFIXES and word[:-2] in TYPE_NAMES:
            return _RowType(TYPE_NAMES[word[:-2]], ORDER_SUFFIXES[word[-2:]])
        raise NotConvertible(f"type {text!r} is not known")

    def _type_and_count(
        self, kind: _RowType, place: _RowAddress, cells: RowCells
    ) -> tuple[str | None, int | None]:
        """The type, widened to the stated registers, and the count of an array or text."""
        if place.half:
            return ("s8" if (kind.word or "u")[0] == "s" else "u8") + place.half[0], None
        if place.bit is not None:
            if kind.word not in (None, "bool"):
                raise NotConvertible(f"a bit of a register is a bool, not {cells.get('type')!r}")
            return "bool", None
        if kind.word == "bool":
            cells.note("a bool without a bit is the whole register")
            return "u16", None
        registers = place.registers or kind.registers or parse_decimal(cells.get("count"))
        length = parse_decimal(cells.get("length"))
        if kind.word in ("str", "raw"):
            if registers is None and length is not None:
                self.builder.note_once("the length of a text counts registers (assumed)")
            registers = registers or length
            if not isinstance(registers, int) or registers < 1:
                raise NotConvertible(f"a {kind.word} without a length")
            return kind.word, registers
        word, width = kind.word or "u16", REGISTERS_OF_TYPE[kind.word or "u16"]
        if place.elements:
            return word, place.elements * width if place.elements > 1 else None
        return self._number(kind, registers, length, (word, width), cells)

    def _number(
        self,
        kind: _RowType,
        registers: float | None,
        length: float | None,
        what: tuple[str, int],
        cells: RowCells,
    ) -> tuple[str, int | None]:
        """The type of a number, widened if only its registers state a width, and a count."""
        word, width = what
        size = registers or length
        wide = {("u16", 2): "u32", ("s16", 2): "s32", ("u16", 4): "u64", ("s16", 4): "s64"}
        if not kind.has_width and (word, size) in wide:
            return wide[word, size], None  # type: ignore[index]
        if not kind.has_width and kind.word is not None and size is None:
            self.builder.note_once("types without a width take 16 bits (assumed)")
        if size in (None, width) or (registers is None and size in (2 * width, 16 * width)):
            # The length is twice or 16 times the width: it counts bytes or bits, not registers.
            return word, None
        if registers is not None and registers >= 1 and registers % width == 0:
            return word, int(registers)
        cells.note(f"a {word} does not take {size} registers; skipped")
        return word, None


def _modicon(digits: str, stated_space: str | None, text: str) -> tuple[str | None, int]:
    """Table and wire address of 40001 or 400001; shorter numbers count from 1 in their table."""
    wrong = NotConvertible(
        f"{text!r} is not a Modicon address" + (f" of {stated_space}" if stated_space else "")
    )
    if not digits.isdigit() or len(digits) > 6:  # noqa: PLR2004 - 400001
        raise wrong
    if len(digits) < 5 or (stated_space and digits[0] == "0"):  # noqa: PLR2004 - 40001
        return stated_space or "co", int(digits) - 1
    space, wire = _DIGITS.get(digits[0]), int(digits[1:]) - 1
    if space is None or (stated_space and stated_space != space) or not 0 <= wire <= _LAST:
        raise wrong
    return space, wire
