"""What the cells of tables say.

Addresses, values, times in milliseconds, states and their colours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

from analyzer.addresses import LAST, SHORT, render
from analyzer.views.grid import Field, Head, Items
from analyzer.views.screen import visible, width_of
from dissectors.table import function as table_function

__all__ = [
    "BASE_TITLES",
    "STATUS_STYLES",
    "VERDICT_STYLES",
    "bits",
    "bus_field",
    "findings",
    "function",
    "function_name",
    "hex_items",
    "labels",
    "milliseconds",
    "number",
    "span",
    "text_of",
    "values",
]

BASE_TITLES = {
    "wire": "addr from 0",
    "hex": "hex from 0",
    "5digit": "40001-based",
    "6digit": "400001-based",
}
"""How the head of an address column names its base."""

STATUS_STYLES = {
    "ok": "good",
    "exception": "odd",
    "no_response": "bad",
    "broadcast": "note",
    "bad_request": "bad",
    "bad_response": "bad",
    "unrequested": "odd",
    "not_seen": "dim",
}

VERDICT_STYLES = {
    "ok": "good",
    "no_checksum": "good",
    "bad_checksum": "bad",
    "incomplete": "bad",
    "noise": "odd",
}

LABEL = 16
"""Columns of a bus's short name."""

_LONG_US = 100_000
"""From here on tenths of a millisecond are noise."""

_BITS = ("coil", "discrete_input")

_OPERATIONS = {"read": "read", "write": "write", "read_write": "r/w"}


def labels(names: Sequence[str]) -> dict[str, str]:
    """Short names for buses: the end of each path, as long as it takes to tell them apart.

    >>> labels(["a/bus.hex", "a/other.hex"])
    {'a/bus.hex': 'bus.hex', 'a/other.hex': 'other.hex'}
    >>> list(labels(["logs/monday/bus.hex", "logs/tuesday/bus.hex"]).values())
    ['monday', 'tuesday']
    """
    parts = {name: visible(name).replace("\\", "/").rstrip("/").split("/") for name in names}
    while len(parts) > 1 and len({tuple(part[-1:]) for part in parts.values()}) == 1:
        if min(map(len, parts.values())) == 1:
            break
        parts = {name: part[:-1] for name, part in parts.items()}
    found: dict[str, str] = {}
    longest = max(map(len, parts.values()), default=0)
    for depth in range(1, longest + 1):
        found = {name: "/".join(part[-depth:]) for name, part in parts.items()}
        if len(set(found.values())) == len(found):
            break
    return {
        name: "…" + label[1 - LABEL :] if len(label) > LABEL else label
        for name, label in found.items()
    }


def bus_field(names: Sequence[str], name_of: Callable[[Any], str]) -> Field:
    """The column that says the bus; `name_of` gives a row's."""
    short = labels(names)
    width = max(map(width_of, short.values()), default=0)
    return Field(Head("bus", min(width, LABEL)), lambda row: short.get(name_of(row), name_of(row)))


def number(value: int | None) -> str:
    """A number, nothing for None."""
    return "" if value is None else str(value)


def milliseconds(microseconds: float | None) -> str:
    """Microseconds as milliseconds.

    >>> milliseconds(1234.5), milliseconds(250_000.0), milliseconds(None)
    ('1.2', '250', '')
    """
    if microseconds is None:
        return ""
    digits = 1 if microseconds < _LONG_US else 0
    return f"{microseconds / 1e3:.{digits}f}"


def span(first: int | None, quantity: int | None, kind: str | None, base: str) -> str:
    """A block of addresses in one of the bases.

    >>> span(107, 3, "holding_register", "wire"), span(107, 1, "holding_register", "5digit")
    ('107-109', '40108')
    """
    return "" if first is None else _span(first, quantity, kind, base)


@lru_cache(maxsize=4096)  # a poll list comes round and round
def _span(first: int, quantity: int | None, kind: str | None, base: str) -> str:
    start = render(first, kind, base)
    if not quantity or quantity == 1:
        return start
    return f"{start}-{render(min(first + quantity - 1, LAST), kind, base)}"


def function(row: Any, *, long: bool) -> str:
    """The function of a row.

    Code and name, or code and what it does to which registers (`3 read hr`).
    """
    code = row.function
    if code is None:
        return ""
    if long:
        return _named(code, row.function_name)
    does, kind = getattr(row, "operation", None), getattr(row, "register_type", None)
    return _doing(code, row.function_name, does, kind)


@lru_cache(maxsize=1024)
def _named(code: int, name: str | None) -> str:
    return f"{code:3d} {visible(name or 'unknown')}"


@lru_cache(maxsize=1024)
def _doing(code: int, name: str | None, does: str | None, kind: str | None) -> str:
    operation, short = _OPERATIONS.get(does or ""), SHORT.get(kind or "")
    text = f"{operation} {short}" if operation and short else visible(name or "unknown")
    return f"{code:2d} {text}"


def function_name(row: Mapping[str, Any]) -> str:
    """Code and name of a function in a row of the statistics.

    >>> function_name({"function": 3})
    ' 3 Read Holding Registers'
    """
    code = row["function"]
    try:
        name = table_function(code).name
    except KeyError:
        name = "unknown"
    return f"{code:2d} {name}"


def values(row: Any, base: str) -> Items:
    """What a transaction carried: values read, values written, decoded fields.

    Where a profile names values, their names and values stand in place of the registers.
    """
    named = row.readings
    if named:
        return Items([visible(f"{name}={_reading(value)}") for name, value in named.items()])
    data = row.data
    if data is not None and row.operation == "read" and row.register_type not in _BITS:
        return Items(data)  # nearly every row
    items: list[str] = []
    counts: list[int] = []

    def add(texts: Sequence[str], how_many: Sequence[int] | None = None) -> None:
        items.extend(texts)
        counts.extend(how_many or [1] * len(texts))

    if data is not None:
        add(*_block(row, data))
    if row.operation == "read_write":
        where = span(row.write_address, row.write_quantity, row.register_type, base)
        add([f"{where}:"], [0])
    if row.write_data is not None:
        add(*_block(row, row.write_data))
    if row.fields:
        add(
            [
                visible(f"{key}={text_of(value)}")
                for key, value in row.fields.items()
                if key != "byte_count"
            ]
        )
    return Items(items, counts)


def _block(row: Any, data: Sequence[int]) -> tuple[list[str], list[int]]:
    """Registers one by one, bits in groups; and how many values each text is."""
    groups = bits(data) if row.register_type in _BITS else list(map(str, data))
    return groups, [len(group) if row.register_type in _BITS else 1 for group in groups]


def _reading(value: Any) -> str:
    return "-" if value is None else text_of(value)


def bits(data: Sequence[int]) -> list[str]:
    """Bits in groups of eight, in wire order.

    >>> bits([1, 0, 1, 1, 0, 0, 1, 1, 1])
    ['10110011', '1']
    """
    text = "".join(map(str, data))
    return [text[start : start + 8] for start in range(0, len(text), 8)]


def text_of(value: Any) -> str:
    """A decoded field on one line."""
    if isinstance(value, dict):
        return "{" + " ".join(f"{key}={text_of(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + " ".join(text_of(inner) for inner in value) + "]"
    return value.hex() if isinstance(value, bytes) else str(value)


def findings(row: Any) -> str:
    """The codes of a row's findings, with commas; what its status says already is left out."""
    found = row.findings
    if not found:
        return ""
    said = (getattr(row, "status", None), getattr(row, "verdict", None))
    return visible(",".join(dict.fromkeys(code for code in found if code not in said)))


def hex_items(data: bytes | None) -> Items:
    """Bytes as pairs of hex digits."""
    return Items((data or b"").hex(" ").split())
