"""A profile under construction: what importers have in common.

Points with wire addresses go in; a name that stands twice gets a number, a register that is taken
stays with the first point, and both are notes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from dissectors.errors import UsageError
from dissectors.words import number, plain

__all__ = ["ORDERS", "SPACES", "WIDTHS", "Draft", "Imported", "Options", "order_of", "tidy"]

WIDTHS: Mapping[str, int] = {
    "bool": 1, "u8h": 1, "u8l": 1, "s8h": 1, "s8l": 1, "u16": 1, "s16": 1, "f16": 1, "bcd16": 1,
    "u32": 2, "s32": 2, "f32": 2, "bcd32": 2, "u64": 4, "s64": 4, "f64": 4,
}  # fmt: skip
"""Registers of the types that do not need `count`."""

SPACES: Mapping[str, str] = {
    plain(word): space
    for space, words in {
        "hr": (
            "hr",
            "holding",
            "holding_register",
            "holding registers",
            "h",
            "4",
            "4x",
            "3 holding",
        ),
        "ir": ("ir", "input", "input_register", "input registers", "read", "3x", "analog input"),
        "co": ("co", "coil", "coils", "c", "0x", "discrete output", "digital output"),
        "di": ("di", "discrete", "discrete_input", "discrete inputs", "discreteinput", "1x"),
    }.items()
    for word in words
}
"""What other programs call the four tables."""

ORDERS: Mapping[str, str] = {
    plain(word): order
    for order, words in {
        "ABCD": ("ABCD", "AB", "ABCDEFGH", "big", "big_endian", "BE_BE", "1234", "highlow",
                 "MSWLSW", "none", "BE", "12"),
        "CDAB": ("CDAB", "GHEFCDAB", "word", "word swap", "lowhigh", "LSWMSW", "3412", "sw",
                 "LE_BE", "little_endian_words"),
        "BADC": ("BADC", "BA", "BADCFEHG", "byte", "byte swap", "2143", "sb", "BE_LE", "21"),
        "DCBA": ("DCBA", "HGFEDCBA", "little", "little_endian", "LE_LE", "4321", "word_byte", "LE"),
    }.items()
    for word in words
}  # fmt: skip
"""What other programs call the four orders (one table for all of them)."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the person says because the file does not.

    - `base`: how addresses count: 0, 1 or "modicon"
    - `order`: of values of several registers
    - `unit`: whose registers, where a file has those of several units
    """

    base: int | str | None = None
    order: str | None = None
    unit: int | None = None


@dataclass(frozen=True, slots=True)
class Imported:
    """A model in the words of profiles, and notes on what was assumed and what was left out."""

    model: dict[str, Any]
    notes: tuple[str, ...]


@dataclass(slots=True)
class Draft:
    """Points so far, and notes; `device` are keys of `[device]`."""

    device: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    _points: list[dict[str, Any]] = field(default_factory=list)
    _taken: dict[tuple[str, int], str] = field(default_factory=dict)
    _dropped: dict[str, int] = field(default_factory=dict)
    _names: set[str] = field(default_factory=set)

    def add(
        self,
        name: str,
        space: str,
        address: int,
        *,
        part: tuple[int, int] | None = None,
        **keys: Any,
    ) -> None:
        """A point at a wire address, or a part of it (first and last bit).

        Keys that are None or empty are left out.
        """
        name = name.strip()
        if not 0 <= address <= 0xFFFF:  # noqa: PLR2004 - the last address
            self.notes.append(f"{name}: wire address {address} is none; left out")
            return
        point = {key: value for key, value in keys.items() if value not in (None, "", {}, [])}
        kind = point.get("type", "u16")
        width = point.get("count") or WIDTHS.get(kind, 1)
        whole = part is None and not kind.startswith(("u8", "s8"))
        places = [(space, address + offset) for offset in range(width)] if whole else []
        for place in places:
            if place in self._taken:
                other = self._taken[place]
                self.notes.append(f"{name}: {space}:{place[1]} belongs to {other}; left out")
                return
        unique = self._unique(name or f"{space}_{address}")
        self._taken.update(dict.fromkeys(places, unique))
        bits = ""
        if part is not None:
            bits = f".{part[0]}" if part[0] == part[1] else f".{part[0]}-{part[1]}"
        self._points.append({"at": f"{space}:{address}{bits}", "name": unique, **point})

    def dropped(self, keys: Iterable[str], why: str = "has no place in a profile") -> None:
        """Features that were left out; the same one of several points is one note."""
        for key in keys:
            text = f"{key}: {why}"
            self._dropped[text] = self._dropped.get(text, 0) + 1

    def done(self) -> Imported:
        """The model; points by table and address."""
        for text, count in self._dropped.items():
            self.notes.append(f"{text} ({count} times)" if count > 1 else text)
        device = {"address_base": 0, **self.device}
        model = {"profile": 1, "device": device, "registers": self._points}
        return Imported(model, tuple(self.notes))

    def _unique(self, name: str) -> str:
        unique, count = name, 1
        while unique in self._names:
            count += 1
            unique = f"{name}_{count}"
        if unique != name:
            self.notes.append(f"{name}: the name stands twice; called {unique}")
        self._names.add(unique)
        return unique


def order_of(word: object, where: str) -> str | None:
    """The order that another program's word means, None for none; `UsageError` if unknown."""
    if word in (None, ""):
        return None
    found = ORDERS.get(plain(str(word)))
    if found is None:
        raise UsageError(f"{where}: {word!r} is no order of bytes; ABCD, CDAB, BADC or DCBA")
    return found


def tidy(value: object) -> int | float | None:
    """A number as profiles write it: `0.1`, `1` for 1.0, None where it says nothing.

    >>> tidy("0,5"), tidy(1.0), tidy("0x10"), tidy("")
    (0.5, 1, 16, None)
    """
    if value in (None, ""):
        return None
    if isinstance(value, str):
        whole = number(value)
        if whole is not None:
            return whole
        value = value.strip().replace(",", ".")
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None
    return int(found) if found.is_integer() and abs(found) < 2**53 else found
