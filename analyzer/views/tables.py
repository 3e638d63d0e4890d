"""What each of the four tables shows, in which columns, in how much room.

`fields` gives the columns of a table for a width; the first rows decide what is worth a column (no
response times without a clock, no bus where there is one only).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from analyzer.addresses import SHORT
from analyzer.views import cells
from analyzer.views.grid import ROOMY, Field, Head, Items, Run
from analyzer.views.moments import Moments
from analyzer.views.screen import visible

__all__ = ["Look", "fields"]


@dataclass(frozen=True, slots=True)
class Look:
    """How a table looks.

    `address` is one of `addresses.BASES`, `times` one of `moments.TIMES`; `buses` are the names of
    the buses: where there are several, each row says its own.
    """

    address: str = "wire"
    times: str = "local"
    buses: tuple[str, ...] = ()


def fields(
    table: str, look: Look, rows: Sequence[Any], width: int, moments: Moments
) -> list[Field]:
    """The columns of a table; `rows` are its first rows."""
    chosen = _TABLES[table](look, rows, width >= ROOMY)
    chosen.insert(1, moments.field())
    # A capture's buses are the servers that show in it, however the file is called.
    servers = dict.fromkeys(str(row.bus) for row in rows if getattr(row, "server", None))
    if servers or len(look.buses) > 1:
        names = tuple(servers) or look.buses
        chosen.insert(2, cells.bus_field(names, lambda row: str(row.bus)))
    return chosen


def _transactions(look: Look, rows: Sequence[Any], roomy: bool) -> list[Field]:
    def function(row: Any) -> str:
        return cells.function(row, long=roomy)

    def rest(row: Any) -> Run:
        found = (cells.findings(row), "odd")
        values = cells.values(row, look.address)
        refused = visible(row.exception_name or "")
        if refused and values.values:
            refused += ":"
        return Run([found, (refused, ""), (values, "")])

    chosen = [
        Field(Head("txn", 4, right=True), lambda row: cells.number(row.txn)),
        _UNIT,
        Field(Head("function", 11, most=28 if roomy else 14), function),
        Field(Head(cells.BASE_TITLES[look.address], 11), lambda row: _address(row, look.address)),
    ]
    if any(row.elapsed_us is not None for row in rows):
        chosen.append(Field(Head("ms", 5, right=True), _response_ms))
    return chosen + _ending("status", _status, _status_style, rest, roomy=roomy)


def _frames(look: Look, rows: Sequence[Any], roomy: bool) -> list[Field]:
    def rest(row: Any) -> Run:
        return Run([(cells.findings(row), "odd"), (cells.hex_items(row.hex), "")])

    chosen = [
        Field(Head("frame", 5, right=True), lambda row: cells.number(row.frame)),
        Field(Head("dir", 3), lambda row: _DIRECTIONS.get(row.direction, "?")),
        _UNIT,
        Field(Head("function", 24, most=28), _function) if roomy else Field(Head("fc", 3), _code),
        Field(Head("len", 3, right=True), lambda row: cells.number(row.byte_length)),
    ]
    if any(row.elapsed_us is not None for row in rows):
        chosen.append(Field(Head("gap ms", 6, right=True), _gap_ms))
    return chosen + _ending("verdict", lambda row: row.verdict, _verdict_style, rest, roomy=roomy)


def _ending(
    title: str,
    state: Callable[[Any], str],
    style: Callable[[Any], str],
    rest: Callable[[Any], Run],
    *,
    roomy: bool,
) -> list[Field]:
    """The last columns: a state, then findings and content in what room is left.

    In little room both are one column: most states are `ok`, which leaves more for the content.
    """
    content = "bytes" if title == "verdict" else "values"
    if roomy:
        field = Field(Head(title, 12), state, style)
        return [field, Field(Head(f"findings, {content}", 12, share=1), rest)]
    both = Head(f"{title}, {content}", 11, share=1)
    return [Field(both, lambda row: Run([(state(row), style(row)), *rest(row).pieces]))]


def _readings(look: Look, rows: Sequence[Any], roomy: bool) -> list[Field]:
    def address(row: Any) -> str:
        return cells.span(row.address, 1, row.register_type, look.address)

    return [
        Field(Head("txn", 4, right=True), lambda row: cells.number(row.txn)),
        _UNIT,
        Field(Head("type", 4), lambda row: SHORT.get(row.register_type, "")),
        Field(Head(cells.BASE_TITLES[look.address], 6, right=True), address),
        Field(Head("does", 5), lambda row: row.operation or ""),
        Field(Head("raw", 5, right=True), lambda row: Items([str(one) for one in row.raw or ()])),
        Field(Head("value", 8, share=1), _value),
        Field(Head("status", 11), lambda row: row.status or "", _status_style),
    ]


def _found(look: Look, rows: Sequence[Any], roomy: bool) -> list[Field]:
    chosen = [
        Field(Head("frame", 5, right=True), lambda row: cells.number(row.frame)),
        Field(Head("txn", 4, right=True), lambda row: cells.number(row.txn)),
        _UNIT,
        Field(Head("severity", 8), lambda row: row.severity, _severity_style),
        Field(Head("code", 16), lambda row: row.code, _severity_style),
        Field(Head("what was seen", 10, share=1), lambda row: visible(row.detail or "")),
    ]
    if roomy:
        advice = Head("what to check", 20, share=1)
        chosen.append(Field(advice, lambda row: visible(row.advice or "")))
    return chosen


_TABLES: dict[str, Callable[[Look, Sequence[Any], bool], list[Field]]] = {
    "transactions": _transactions,
    "frames": _frames,
    "readings": _readings,
    "findings": _found,
}

_DIRECTIONS = {"request": "req", "response": "rsp"}
_SEVERITIES = {"error": "bad", "warning": "odd", "info": "note"}
_UNIT = Field(Head("unit", 4, right=True), lambda row: cells.number(row.unit))


def _address(row: Any, base: str) -> str:
    if row.address is not None:
        return cells.span(row.address, row.quantity, row.register_type, base)
    return cells.span(row.write_address, row.write_quantity, row.register_type, base)


def _response_ms(row: Any) -> str:
    if row.response_time_us is not None:
        return cells.milliseconds(row.response_time_us)
    if row.late_response_us is not None:
        return cells.milliseconds(row.late_response_us)
    return f">{cells.milliseconds(row.waited_us)}" if row.waited_us is not None else ""


def _status(row: Any) -> str:
    return str(row.status) if row.exception is None else f"{row.status} {row.exception}"


def _gap_ms(row: Any) -> str:
    return cells.milliseconds(row.gap_us)


def _function(row: Any) -> str:
    return cells.function(row, long=True)


def _code(row: Any) -> str:
    return "" if row.function is None else f"{row.function:3d}"


def _value(row: Any) -> str:
    parts = (row.name, row.value_text, row.unit_of_measure)
    return visible(" ".join(part for part in parts if part))


def _status_style(row: Any) -> str:
    return cells.STATUS_STYLES.get(row.status, "")


def _verdict_style(row: Any) -> str:
    return cells.VERDICT_STYLES.get(row.verdict, "")


def _severity_style(row: Any) -> str:
    return _SEVERITIES.get(row.severity, "")
