"""The table of functions, as the core has read it.

The rows are in functions.toml and vendor/*.toml. The core embeds and checks these files; this
module gives the rows types. Decoding is done by the core, see `dissectors.describe`. Names of
exceptions and other numbers are in `dissectors.vocabulary`.

>>> row = function(0x10)
>>> row.name, row.section
('Write Multiple Registers', '6.12')
>>> [str(field) for field in row.fields("request")]
['address:u16', 'quantity:u16', 'byte_count:len8', 'registers:u16[]']
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import _modlens
from dissectors.texts import vocabulary
from dissectors.vocabulary import exception_name

__all__ = [
    "DIRECTIONS",
    "EXCEPTION_BIT",
    "LIST_ITEM_BYTES",
    "NUMBER_BYTES",
    "Direction",
    "Field",
    "Function",
    "exception_name",
    "function",
    "functions",
    "row_of",
]

Direction = Literal["request", "response"]

DIRECTIONS: tuple[Direction, ...] = ("request", "response")

EXCEPTION_BIT = 0x80
"""Set in the function code of an exception response (section 7)."""

NUMBER_BYTES: Mapping[str, int] = {
    "u8": 1, "len8": 1, "count8": 1, "u16": 2, "len16": 2, "count16": 2,
}  # fmt: skip
"""Field types of single numbers -> size in bytes."""

LIST_ITEM_BYTES: Mapping[str, int] = {"u8[]": 1, "u16[]": 2}
"""Field types of lists of numbers -> size of one item in bytes."""


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a PDU's body: its name and type; `children` are the fields of a group's item.

    >>> groups = function(0x14).fields("request")[1]
    >>> groups.field_type, [child.name for child in groups.children]
    ('group', ['reference_type', 'file', 'record', 'length'])
    """

    name: str
    field_type: str
    children: tuple[Field, ...] = ()

    def __str__(self) -> str:
        inner = f"{{{' '.join(map(str, self.children))}}}" if self.field_type == "group" else ""
        return f"{self.name}:{self.field_type}{inner}"

    @classmethod
    def parse(cls, text: str) -> Field:
        """Parse "name:type"; the core has already checked it."""
        name, field_type = text.split(":", 1)
        if not field_type.startswith("group{"):
            return cls(name, field_type)
        inner = field_type.removeprefix("group{").removesuffix("}")
        return cls(name, "group", tuple(cls.parse(item) for item in inner.split()))


@dataclass(frozen=True, slots=True)
class Function:
    """A row of the table; `request` or `response` is None where the layout is not public."""

    code: int
    name: str
    when: tuple[str, int] | None
    section: str
    summary: str
    request: tuple[Field, ...] | None
    response: tuple[Field, ...] | None
    has_response: bool
    echo: tuple[str, ...]
    limits: Mapping[str, tuple[int, int]] = field(hash=False)
    allowed: Mapping[str, tuple[int, ...]] = field(hash=False)
    operation: str
    register_type: str | None
    serial_only: bool
    vendor: str | None
    example_request: bytes
    example_response: bytes | None

    @property
    def label(self) -> str:
        """A name that no other row has.

        For a row with `when` it is the text before the colon of the summary.

        >>> function(8, when=4).label, function(8).label
        ('Force Listen Only Mode', 'Diagnostics')
        """
        if self.when is None:
            return self.name
        own, colon, _ = self.summary.partition(":")
        return own if colon else f"{self.name} {self.when[1]}"

    def fields(self, direction: Direction) -> tuple[Field, ...]:
        """The fields of the body in a direction; empty where the layout is not known."""
        return (self.request if direction == "request" else self.response) or ()

    def has_layout(self, direction: Direction) -> bool:
        """Whether the layout of the body in a direction is known.

        >>> function(0x5A).has_layout("request"), function(8, when=4).has_layout("response")
        (False, False)
        """
        return (self.request if direction == "request" else self.response) is not None

    def quantities(self, direction: Direction) -> dict[str, str]:
        """Quantity field -> list in the same body that it counts.

        `quantity` counts `registers` or `coils`, `write_quantity` counts `write_registers`. Where a
        request asks for something there is no list, and the quantity is the caller's.

        >>> function(0x17).quantities("request")
        {'write_quantity': 'write_registers'}
        """
        body = self.fields(direction)
        known = {item.name for item in body}
        pairs = {}
        for item in body:
            prefix = item.name[: item.name.rfind("_") + 1]
            if (
                item.field_type in LIST_ITEM_BYTES or item.field_type == "bits"
            ) and f"{prefix}quantity" in known:
                pairs[f"{prefix}quantity"] = item.name
        return pairs


def functions(source: _modlens.Functions | None = None) -> tuple[Function, ...]:
    """The rows in the order of the table: the embedded ones, or all those of `source`.

    >>> len({row.code for row in functions()})
    20
    """
    return _embedded() if source is None else _rows_of(source, source.loads)


def function(
    code: int, *, when: int | None = None, source: _modlens.Functions | None = None
) -> Function:
    """The row of a function code; `when` is the leading field's value where rows depend on it.

    `KeyError` where no row has the code. Later rows win, as in the core.

    >>> function(0x2B, when=14).label
    'Read Device Identification'
    """
    rows = [row for row in functions(source) if row.code == code]
    special = [row for row in rows if row.when is not None and row.when[1] == when]
    general = [row for row in rows if row.when is None]
    chosen = special or general
    if not chosen:
        raise KeyError(code)
    return chosen[-1]


def row_of(pdu: bytes, *, source: _modlens.Functions | None = None) -> Function | None:
    r"""The row for a PDU, exception responses included; None where the table has none.

    >>> row_of(bytes.fromhex("08 0004 0000")).label, row_of(b"\x63")
    ('Force Listen Only Mode', None)
    """
    if not pdu:
        return None
    code = pdu[0] & ~EXCEPTION_BIT
    special = [row for row in functions(source) if row.code == code and row.when]
    width = NUMBER_BYTES[special[0].fields("request")[0].field_type] if special else 0
    # An exception response has no leading field.
    leading = b"" if pdu[0] & EXCEPTION_BIT else pdu[1 : 1 + width]
    try:
        return function(
            code, when=int.from_bytes(leading, "big") if leading else None, source=source
        )
    except KeyError:
        return None


@functools.cache
def _embedded() -> tuple[Function, ...]:
    return tuple(_function(row) for row in vocabulary("functions"))


@functools.lru_cache(maxsize=4)
def _rows_of(source: _modlens.Functions, loads: int) -> tuple[Function, ...]:
    """The rows of a table after so many `load`s: they are asked for again and again."""
    return tuple(_function(row) for row in json.loads(source.rows()))


def _function(row: Mapping[str, Any]) -> Function:
    """A row from the core's JSON."""
    when = row.get("when") or {}
    example = row.get("example") or {}
    answer = example.get("response")
    return Function(
        code=row["code"],
        name=row["name"],
        when=next(iter(when.items()), None),
        section=row["section"],
        summary=row["summary"],
        request=_body(row.get("request")),
        response=_body(row.get("response")),
        has_response=row.get("response") != "none",
        echo=tuple(row.get("echo") or ()),
        limits={name: (low, high) for name, (low, high) in (row.get("limits") or {}).items()},
        allowed={name: tuple(values) for name, values in (row.get("allowed") or {}).items()},
        operation=row["operation"],
        register_type=row.get("register_type"),
        serial_only=bool(row.get("serial_only")),
        vendor=row.get("vendor"),
        example_request=bytes.fromhex(example.get("request") or ""),
        example_response=None if answer is None else bytes.fromhex(answer),
    )


def _body(fields: list[str] | str | None) -> tuple[Field, ...] | None:
    if fields is None or fields == "none":
        return None
    return tuple(Field.parse(text) for text in fields)
