"""Things of openHAB's Modbus binding (`.things`): pollers and data; addresses as on the wire.

>>> from dissectors.importers.profile_builder import Options
>>> text = '''Bridge modbus:tcp:m [ host="10.0.0.2", id=1 ] {
...   Bridge poller p [ start=20, length=2, type="input" ] {
...     Thing data power [ readStart="20", readValueType="float32_swap" ]
...   }
... }'''
>>> read(text, "x.things", Options()).model["registers"]
[{'at': 'ir:20', 'name': 'power', 'type': 'f32', 'order': 'CDAB'}]
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from dissectors.errors import ProfileError
from dissectors.importers.profile_builder import (
    Imported,
    NotConvertible,
    Options,
    ProfileBuilder,
    choose_unit,
    parse_decimal,
)

__all__ = ["read"]

_TOKEN = re.compile(
    r'(?P<skip>\s+|//[^\n]*|/\*.*?\*/)|"(?P<text>(?:\\.|[^"\\])*)"|(?P<mark>[\[\]{}=,@])'
    r"|(?P<word>[^\s\[\]{}=,@\"]+)",
    re.DOTALL,
)
_SPACES = {"coil": "co", "discrete": "di", "holding": "hr", "input": "ir"}
_KINDS = {
    "int16": "s16", "uint16": "u16", "int32": "s32", "uint32": "u32", "int64": "s64",
    "uint64": "u64", "float32": "f32",
}  # fmt: skip
_BYTES = {"int8": "s8", "uint8": "u8"}

Token = tuple[str, str]


@dataclass(frozen=True, slots=True)
class _Data:
    """A data thing: its name, the unit and the table of its poller, its parameters."""

    name: str
    unit: int | None
    space: str | None
    parameters: Mapping[str, str]


def read(text: str, name: str, options: Options) -> Imported:
    """Read the data things; `ProfileError` where there are none."""
    if "modbus" not in text and "poller" not in text:
        raise ProfileError("no things of the Modbus binding in it", path=name)
    found = list(_Things(list(_tokens(text.lstrip("\ufeff")))).data(None, None))
    if not found:
        raise ProfileError("no `Thing data` below a bridge of the Modbus binding", path=name)
    builder = ProfileBuilder({"source": f"openHAB things {name}"}, options.order)
    builder.notes.append("addresses count from 0, as openHAB does")
    unit = choose_unit((data.unit for data in found), options.unit, name)
    for data in found:
        if data.unit in (unit, None):
            with builder.noting_failures(data.name):
                _add(builder, data)
    return builder.build()


def _tokens(text: str) -> Iterator[Token]:
    for match in _TOKEN.finditer(text):
        if match["text"] is not None:
            yield "text", match["text"]
        elif match["mark"] or match["word"]:
            yield "mark" if match["mark"] else "word", match["mark"] or match["word"]


class _Things:
    """Reads bridges and things from tokens."""

    def __init__(self, tokens: list[Token]) -> None:
        self._tokens, self._at = tokens, 0

    def data(self, unit: int | None, space: str | None) -> Iterator[_Data]:
        """The data things up to the end of a block; `unit` and `space` are those of its bridge."""
        while self._at < len(self._tokens):
            kind, word = self._next()
            if (kind, word) == ("mark", "}"):
                return
            if kind == "word" and word in ("Bridge", "Thing"):
                yield from self._thing(unit, space)

    def _thing(self, unit: int | None, space: str | None) -> Iterator[_Data]:
        """The data things of one `Bridge` or `Thing`."""
        names = self._names()
        parameters = self._parameters()
        # `modbus:tcp:name`, or `poller name` below a bridge.
        parts = ":".join(names).split(":")
        kind = next((part for part in parts if part in ("data", "poller", "tcp", "serial")), "")
        number = parse_decimal(parameters.get("id"))
        if kind in ("tcp", "serial") and isinstance(number, int):
            unit = number
        if kind == "poller":
            space = _SPACES.get(parameters.get("type", ""))
        if kind == "data":
            yield _Data(parts[-1], unit, space, parameters)
        if self._at < len(self._tokens) and self._tokens[self._at] == ("mark", "{"):
            self._at += 1
            yield from self.data(unit, space)

    def _names(self) -> list[str]:
        """The words after `Bridge` or `Thing`; labels and places are left out."""
        names = []
        while self._at < len(self._tokens):
            kind, word = self._tokens[self._at]
            if (kind == "mark" and word != "@") or word in ("Bridge", "Thing"):
                break
            self._at += 1
            if kind == "word":
                names.append(word)
        return names

    def _parameters(self) -> dict[str, str]:
        """The parameters in square brackets, if there are any."""
        found: dict[str, str] = {}
        if self._at >= len(self._tokens) or self._tokens[self._at] != ("mark", "["):
            return found
        self._at += 1
        while self._at < len(self._tokens):
            kind, word = self._next()
            if (kind, word) == ("mark", "]"):
                break
            if kind == "word" and self._tokens[self._at : self._at + 1] == [("mark", "=")]:
                self._at += 1
                if self._at < len(self._tokens):
                    found[word] = self._next()[1]
        return found

    def _next(self) -> Token:
        self._at += 1
        return self._tokens[self._at - 1]


def _add(builder: ProfileBuilder, data: _Data) -> None:
    """Add the point of a data thing; one that is only written has the place of its writes."""
    given = data.parameters
    start, written = given.get("readStart", ""), given.get("writeStart", "")
    is_read = bool(start)
    space = data.space if is_read else _SPACES.get(given.get("writeType", ""))
    if space is None:
        raise NotConvertible("no poller of a known type is above it" if is_read else "no readStart")
    kind = given.get("readValueType" if is_read else "writeValueType", "")
    access = None if is_read and not written else "rw" if is_read else "w"
    if is_read and written and written != start:
        builder.note_dropped(["writeStart beside another readStart"])
        access = None
    address, part, point = _place(start or written, kind, space)
    builder.add(data.name, space, address, part=part, access=access, **point)
    transform = given.get("readTransform", "default")
    if transform != "default":
        builder.note_dropped([f"readTransform {transform}"], "not executed: values are unscaled")


def _place(
    start: str, kind: str, space: str
) -> tuple[int, tuple[int, int] | None, dict[str, str | None]]:
    """Address, bits, and type with order."""
    whole, dot, sub = start.partition(".")
    address, part = parse_decimal(whole), parse_decimal(sub) if dot else 0
    if not isinstance(address, int) or not isinstance(part, int):
        raise NotConvertible(f"{start!r} is not an address")
    if space in ("co", "di"):
        return address, None, {}
    if kind == "bit":
        if not 0 <= part <= 15:  # noqa: PLR2004 - the bits of a register
            raise NotConvertible(f"{start!r} is not a bit of a register")
        return address, (part, part), {}
    if kind in _BYTES:
        # The index counts bytes: 0 is the low one of the register.
        return address + part // 2, None, {"type": _BYTES[kind] + ("h" if part % 2 else "l")}
    plain = kind.removesuffix("_swap")
    if plain not in _KINDS:
        raise NotConvertible(f"value type {kind!r} is not known")
    word = _KINDS[plain]
    order = "CDAB" if kind.endswith("_swap") else "ABCD"
    return address, None, {"type": None if word == "u16" else word, "order": order}
