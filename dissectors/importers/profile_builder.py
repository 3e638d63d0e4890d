"""Builds a profile from points: the common part of all importers.

Points with wire addresses are added. A name that is used twice gets a number, a register that is
taken stays with its first point, and both are noted.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from dissectors.errors import ProfileError, UsageError
from dissectors.function_lookup import normalized, parse_number
from dissectors.profile import from_model

__all__ = [
    "ORDERS",
    "REGISTERS_OF_TYPE",
    "SPACES",
    "Imported",
    "NotConvertible",
    "Options",
    "ProfileBuilder",
    "SeveralUnitsError",
    "choose_unit",
    "compose_orders",
    "parse_decimal",
    "parse_order",
    "parse_row_order",
]

REGISTERS_OF_TYPE: Mapping[str, int] = {
    "bool": 1, "u8h": 1, "u8l": 1, "s8h": 1, "s8l": 1, "u16": 1, "s16": 1, "f16": 1, "bcd16": 1,
    "u32": 2, "s32": 2, "f32": 2, "bcd32": 2, "u64": 4, "s64": 4, "f64": 4,
}  # fmt: skip
"""Type -> registers it takes; types that need `count` are not in it."""

_KEYS = (
    "type", "count", "order", "scale", "offset", "sf", "unit", "access", "enum", "bits", "nan",
    "group", "note",
)  # fmt: skip

_TEXTS = ("str", "strh", "strl", "raw")

_LONGEST = 100
"""Longest number in characters: Python refuses thousands of digits."""

_FLOATS = ("f16", "f32", "f64")

SPACES: Mapping[str, str] = {
    normalized(word): space
    for space, words in {
        "hr": ("hr", "holding", "holding_register", "holding registers", "h", "4x", "3 holding",
               "holdings", "analog_output", "analog_output_holding_registers", "hreg"),
        "ir": ("ir", "input", "input_register", "input registers", "read", "3x", "4 input",
               "analog input", "analog_input_registers", "ireg"),
        "co": ("co", "coil", "coils", "c", "0x", "1 coil", "discrete output", "digital output",
               "discrete_output_coils", "coil status"),
        "di": ("di", "discrete", "discrete_input", "discrete inputs", "discreteinput", "1x",
               "2 discrete", "discrete_input_contacts", "digital input", "input status"),
    }.items()
    for word in words
}  # fmt: skip
"""Normalized word of other programs -> table (hr, ir, co, di)."""

ORDERS: Mapping[str, str] = {
    normalized(word): order
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
"""Normalized word of other programs -> order of bytes and words."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the user says because the file does not.

    - `base`: how addresses count: 0, 1 or "modicon"
    - `order`: of values of several registers
    - `unit`: whose registers, where a file has those of several units
    """

    base: int | str | None = None
    order: str | None = None
    unit: int | None = None


@dataclass(frozen=True, slots=True)
class Imported:
    """A profile model, and notes on what was assumed and what was left out."""

    model: dict[str, Any]
    notes: tuple[str, ...]


class NotConvertible(Exception):  # noqa: N818 - no error: a note
    """Why a row cannot be converted; `ProfileBuilder.noting_failures` makes a note of it."""


@dataclass(slots=True)
class ProfileBuilder:
    """The points added so far, and the notes.

    `device` are keys of `[device]`, `order` is the order of numbers of several registers where a
    point has none, `where` is put before the notes on a point.
    """

    device: dict[str, Any] = field(default_factory=dict)
    order: str | None = None
    where: str = ""
    notes: list[str] = field(default_factory=list)
    _points: list[dict[str, Any]] = field(default_factory=list)
    _name_at: dict[tuple[str, int], str] = field(default_factory=dict)
    _dropped: dict[str, int] = field(default_factory=dict)
    _names: set[str] = field(default_factory=set)
    _noted_once: set[str] = field(default_factory=set)

    def add(
        self,
        name: str,
        space: str,
        address: int,
        *,
        part: tuple[int, int] | None = None,
        **keys: Any,
    ) -> None:
        """Add a point at a wire address, or a part of it (first and last bit).

        Keys that are None or empty are left out; a key that a profile does not permit is left out
        with a note.
        """
        name = name.strip()
        point = {key: value for key, value in keys.items() if value not in (None, "", {}, [])}
        kind = point.get("type", "u16")
        width = point.get("count") or REGISTERS_OF_TYPE.get(kind, 1)
        if not 0 <= address <= 0x10000 - width or width > 0xFFFF:  # noqa: PLR2004 - a u16
            reach = address if address < 0 else address + width - 1
            self._note(f"{name}: wire address {reach} does not exist; skipped")
            return
        whole = part is None and not kind.startswith(("u8", "s8"))
        places = [(space, address + offset) for offset in range(width)] if whole else []
        for place in places:
            if place in self._name_at:
                other = self._name_at[place]
                self._note(f"{name}: {space}:{place[1]} belongs to {other}; skipped")
                return
        unique = self._unique(name or f"{space}_{address}")
        single = space in ("co", "di") or (part is not None and part[0] == part[1])
        self._drop_unsuitable_keys(point, unique, space, "bool" if single else kind)
        self._name_at.update(dict.fromkeys(places, unique))
        bits = ""
        if part is not None:
            bits = f".{part[0]}" if part[0] == part[1] else f".{part[0]}-{part[1]}"
        ordered = {key: point[key] for key in _KEYS if key in point}
        self._points.append({"at": f"{space}:{address}{bits}", "name": unique, **ordered})

    @contextmanager
    def noting_failures(self, label: object) -> Iterator[None]:
        """Note why a row with this label cannot be converted, instead of raising it."""
        try:
            yield
        except NotConvertible as reason:
            self.notes.append(f"{label}: {reason}; skipped")

    def _drop_unsuitable_keys(
        self, point: dict[str, Any], name: str, space: str, kind: str
    ) -> None:
        """Remove the keys of a point that its type does not permit, with a note each."""
        no_number = kind == "bool" or kind in _TEXTS
        refused = {
            **dict.fromkeys(("scale", "offset", "sf", "nan"), no_number),
            "enum": kind in _FLOATS or kind in _TEXTS,
        }
        for key in [key for key, refuses in refused.items() if refuses and key in point]:
            self._note(f"{name}: {key} {point.pop(key)} does not apply to a {kind}; skipped")
        for key in ("scale", "offset"):
            if key in point and not _is_decimal(point[key]):
                self._note(f"{name}: {key} {point.pop(key)} has too many digits; skipped")
        nan = point.pop("nan", [])
        raws = nan if isinstance(nan, list) else [nan]
        kept = [raw for raw in raws if _is_raw(raw, kind)]
        if kept:
            point["nan"] = kept
        if len(kept) < len(raws):
            self._note(f"{name}: nan {nan} is not a raw value of a {kind}; skipped")
        for key in ("unit", "group", "note"):
            value = point.get(key, "")
            if isinstance(value, bool) or not isinstance(value, str | int | float):
                self._note(f"{name}: {key} {point.pop(key)!r} is not text; skipped")
        order = point.pop("order", None)
        if REGISTERS_OF_TYPE.get(kind, 1) > 1:
            order = order or self.order
        elif order is not None:
            # For one register, or a text, only the order of the two bytes of a register matters.
            order = "BADC" if order in ("BADC", "DCBA") and space in ("hr", "ir") else None
        if order not in (None, "ABCD"):
            point["order"] = order

    def note_dropped(self, keys: Iterable[str], why: str = "cannot be kept in a profile") -> None:
        """Count features that were left out; the same one of several points gives one note."""
        for key in keys:
            text = f"{key}: {why}"
            self._dropped[text] = self._dropped.get(text, 0) + 1

    def note_once(self, note: str) -> None:
        """Add a note unless it has been added before."""
        if note not in self._noted_once:
            self._noted_once.add(note)
            self.notes.append(note)

    def build(self) -> Imported:
        """The finished model, with its points in the order of the file, and the notes."""
        for text, count in self._dropped.items():
            self.notes.append(f"{text} ({count} times)" if count > 1 else text)
        model = self._model(self._points)
        if _mistake(model) is not None:
            model = self._model(self._valid_points())
        return Imported(model, tuple(self.notes))

    def _model(self, points: list[dict[str, Any]]) -> dict[str, Any]:
        return {"profile": 1, "device": {"address_base": 0, **self.device}, "registers": points}

    def _valid_points(self) -> list[dict[str, Any]]:
        """The points that a profile can hold, each judged alone; a note for each of the others."""
        valid = []
        for point in self._points:
            # A scale factor is another point, which is not there when this one is judged alone.
            alone = {key: value for key, value in point.items() if key != "sf"}
            mistake = _mistake(self._model([alone]))
            if mistake is None:
                valid.append(point)
            else:
                self.notes.append(f"{point['name']}: {mistake}; skipped")
        return self._with_known_scale_factors(valid)

    def _with_known_scale_factors(self, points: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The points without those `sf` that name no point, a note for each."""
        names = {point["name"] for point in points}
        kept = []
        for point in points:
            factor = point.get("sf")
            if factor in (None, *names):
                kept.append(point)
                continue
            self.notes.append(
                f"{point['name']}: there is no point {factor!r} for its scale factor; left unscaled"
            )
            kept.append({key: value for key, value in point.items() if key != "sf"})
        return kept

    def _note(self, note: str) -> None:
        self.notes.append(self.where + note)

    def _unique(self, name: str) -> str:
        unique, count = name, 1
        while unique in self._names:
            count += 1
            unique = f"{name}_{count}"
        if unique != name:
            self._note(f"{name}: the name appears twice; renamed to {unique}")
        self._names.add(unique)
        return unique


def _mistake(model: Mapping[str, Any]) -> str | None:
    """What is wrong with a model, in the words of the profile's reader; None if it is valid."""
    try:
        from_model(model, "import")
    except ProfileError as error:
        return error.mistakes[0].message.removeprefix("import: ")
    return None


def choose_unit(units: Iterable[int | None], requested: int | None, name: str) -> int | None:
    """The unit whose registers are read: the requested one, or the only one.

    None where a file has no units. `UsageError` where there are several and none is requested, or
    the requested one is not in the file.
    """
    known = sorted({unit for unit in units if unit is not None})
    if requested is None and len(known) < 2:  # noqa: PLR2004 - nothing to choose
        return next(iter(known), None)
    if requested is None:
        raise SeveralUnitsError(name, tuple(known))
    if known and requested not in known:
        there = ", ".join(map(str, known))
        raise UsageError(f"{name}: choose a unit with --unit N; there are {there}")
    return requested


class SeveralUnitsError(UsageError):
    """A register map of several `units` where the text of one profile was asked for.

    `form` is the format of the file, where that was detected.
    """

    def __init__(self, name: str, units: tuple[int, ...]) -> None:
        there = ", ".join(map(str, units))
        super().__init__(
            f"{name}: choose a unit with --unit N; there are {there}. Or -o FILE.toml, for a bus"
            " file with a profile for each"
        )
        self.units = units
        self.form: str | None = None


def parse_row_order(word: object) -> str | None:
    """Parse an order in a file; None for an empty word, `NotConvertible` for an unknown one."""
    try:
        return parse_order(word, "")
    except UsageError:
        raise NotConvertible(f"{word!r} is not a byte order") from None


def parse_order(word: object, where: str) -> str | None:
    """Parse another program's word for an order; None if empty, `UsageError` if unknown."""
    if word in (None, ""):
        return None
    found = ORDERS.get(normalized(str(word)))
    if found is None:
        raise UsageError(f"{where}: {word!r} is not a byte order; ABCD, CDAB, BADC or DCBA")
    return found


def compose_orders(*orders: str | None) -> str:
    """The order that results from applying several orders one after the other.

    Each order swaps the words or not, and the bytes of each word or not.

    >>> compose_orders("DCBA", "CDAB"), compose_orders(None, "BADC"), compose_orders("CDAB", "CDAB")
    ('BADC', 'BADC', 'ABCD')
    """
    by_turns = ("ABCD", "CDAB", "BADC", "DCBA")  # bit 0: the words, bit 1: the bytes
    turns = 0
    for order in orders:
        turns ^= by_turns.index(order or "ABCD")
    return by_turns[turns]


def parse_decimal(value: object) -> int | float | None:  # noqa: PLR0911 - a way a kind of number
    """Parse a number; whole numbers become int, None where it is not a finite number.

    >>> [parse_decimal(value) for value in ("0,5", 1.0, "0x10", "", "1/10", "inf")]
    [0.5, 1, 16, None, 0.1, None]
    """
    if value in (None, "") or isinstance(value, bool):
        return None
    if isinstance(value, str):
        if len(value) > _LONGEST:
            return None
        whole = parse_number(value)
        if whole is not None:
            return whole
        above, slash, below = value.partition("/")
        divisor = parse_decimal(below) if slash else None
        if divisor:
            dividend = parse_decimal(above)
            return None if dividend is None else parse_decimal(dividend / divisor)
        value = value.strip().replace(",", ".")
    if isinstance(value, int):
        return value
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None
    if not math.isfinite(found):
        return None
    return int(found) if found.is_integer() and abs(found) < 2**53 else found


def _is_decimal(value: float) -> bool:
    """Whether a number has at most 18 digits, as the core requires of scale and offset."""
    return value == 0 or 1e-46 < abs(value) < 1e18  # noqa: PLR2004


def _is_raw(value: float, kind: str) -> bool:
    """Whether registers can hold a value: a whole number of 64 bits, or a float of a float type."""
    whole = isinstance(value, int) and -(2**63) <= value < 2**64
    return whole or (isinstance(value, float) and kind in _FLOATS)
