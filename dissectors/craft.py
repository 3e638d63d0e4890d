r"""Makes frames from keywords: the core encodes the PDU, here the frame is put around it.

For tests, examples and replay; nothing here sends. Lengths, counts and quantities that follow from
other values are filled in where they are left out, and taken as they are where they are given, so
that invalid frames can be made on purpose.

>>> craft("Read Holding Registers", unit=17, values={"address": 107, "quantity": 3}).hex(" ")
'11 03 00 6b 00 03 76 87'
>>> craft(16, unit=17, mode="ascii", values={"address": 1, "registers": [10, 258]})
b':11100001000204000A0102CB\r\n'
>>> craft(3, unit=17, direction="response", values={"exception": 2}).hex(" ")
'11 83 02 c1 34'
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Literal

import _modlens
from dissectors.errors import UsageError
from dissectors.function_lookup import find_function, normalized, parse_number, similar_name
from dissectors.pdu import default_functions
from dissectors.table import EXCEPTION_BIT, Direction, Field, Function, function, functions
from dissectors.values import Json, coil_state, to_json
from dissectors.vocabulary import names

__all__ = ["craft", "craft_pdu", "frame"]

MAX_UNIT = 255
MAX_EXCEPTION = 255
MAX_MBAP_ID = 0xFFFF


def craft(  # noqa: PLR0913 - all by keyword, as the command has them
    function: int | str,
    *,
    unit: int = 1,
    direction: Direction = "request",
    mode: Literal["rtu", "ascii", "tcp"] = "rtu",
    values: Mapping[str, object] | None = None,
    mbap_id: int = 1,
    functions: _modlens.Functions | None = None,
) -> bytes:
    """Make the frame of a function, given as a code or name, with values by field name.

    A value is a number, a list, bytes, or the text of one (`0x6B`, `1,2,3`, `on`, hex); a group is
    a list of mappings. `{"exception": 2}` makes an exception response; its name will do too.
    Addresses are wire addresses, from 0. `UsageError` says which value is wrong and what it takes.
    """
    pdu = craft_pdu(function, direction=direction, values=values, functions=functions)
    return frame(pdu, unit=unit, mode=mode, mbap_id=mbap_id)


def craft_pdu(
    function: int | str,
    *,
    direction: Direction = "request",
    values: Mapping[str, object] | None = None,
    functions: _modlens.Functions | None = None,
) -> bytes:
    """Make the PDU of a function, without unit and checksum; arguments as of `craft`.

    >>> craft_pdu(43, values={"mei_type": 14, "read_device_id_code": 1, "object_id": 0}).hex(" ")
    '2b 0e 01 00'
    """
    choice = find_function(function, source=functions)
    given = _merged(choice.preset, values or {})
    for key in ("exception", "exception_code"):
        if key in given:
            return bytes([choice.code | EXCEPTION_BIT, _exception(given[key])])
    row = _row(choice.code, given, functions)
    if row is None or not row.has_layout(direction):
        return _without_layout(choice.code, row, direction, given)
    filled = _with_implied_values(row, direction, given)
    fields = [field for field in row.fields(direction) if field.name in filled]
    tree = {field.name: _value(row, field, filled[field.name]) for field in fields}
    try:
        return (functions or default_functions()).encode(choice.code, direction, json.dumps(tree))
    except ValueError as error:
        raise UsageError(str(error)) from None


def frame(
    pdu: bytes, *, unit: int = 1, mode: Literal["rtu", "ascii", "tcp"] = "rtu", mbap_id: int = 1
) -> bytes:
    r"""Put unit, checksum and delimiters, or the MBAP header, around a PDU.

    >>> frame(b"\x07", unit=1, mode="tcp", mbap_id=5).hex(" ")
    '00 05 00 00 00 02 01 07'
    """
    if not 0 <= unit <= MAX_UNIT:
        raise UsageError(f"unit must be 0 to {MAX_UNIT}, not {unit}")
    if not 0 <= mbap_id <= MAX_MBAP_ID:
        raise UsageError(f"transaction identifier {mbap_id} is not from 0 to {MAX_MBAP_ID}")
    body = bytes([unit]) + pdu
    if mode == "tcp":
        return mbap_id.to_bytes(2, "big") + b"\0\0" + len(body).to_bytes(2, "big") + body
    if mode == "ascii":
        checked = body + bytes([_modlens.lrc(body)])
        return b":" + checked.hex().upper().encode("ascii") + b"\r\n"
    return body + _modlens.crc16(body).to_bytes(2, "little")


def _merged(preset: Mapping[str, int], values: Mapping[str, object]) -> dict[str, object]:
    for name, value in preset.items():
        if name in values and values[name] not in (value, str(value)):
            raise UsageError(f"{name} is {value} for this function, not {values[name]}")
    return {**values, **preset}


def _row(
    code: int, given: Mapping[str, object], source: _modlens.Functions | None
) -> Function | None:
    leading = next((row.when[0] for row in functions(source) if row.code == code and row.when), "")
    chosen = given.get(leading)
    when = chosen if isinstance(chosen, int) else parse_number(str(chosen))
    try:
        return function(code, when=when, source=source)
    except KeyError:
        return None


def _without_layout(
    code: int, row: Function | None, direction: Direction, given: Mapping[str, object]
) -> bytes:
    """The PDU of a function whose layout is not known: its code, and the bytes of `data`."""
    name = f"function {code}" if row is None else row.label
    if row is not None and not row.has_response and direction == "response":
        raise UsageError(f"{name} has no response")
    if set(given) - {"data"}:
        raise UsageError(f"the layout of {name} is not known; give its bytes as data=HEX")
    raw = to_json(Field("data", "bytes"), given.get("data", b""))
    return bytes([code]) + bytes.fromhex(str(raw))


def _with_implied_values(
    row: Function, direction: Direction, given: Mapping[str, object]
) -> dict[str, object]:
    """The values with those that the table implies; `UsageError` for unknown and missing ones."""
    body = row.fields(direction)
    known = [field.name for field in body]
    for name in given:
        if name not in known:
            hint = similar_name(name, known)
            takes = ", ".join(known) or "no fields"
            end = f"it takes {takes}" if hint is None else f"did you mean {hint!r}?"
            raise UsageError(f"{row.label} ({direction}) has no field {name!r}; {end}")
    filled = {**_implied_values(row, body), **given}
    derived = row.quantities(direction)
    for field in body:
        needed = field.field_type in ("u8", "u16") and field.name not in filled
        if needed and derived.get(field.name) not in given:
            raise UsageError(f"{row.label} ({direction}) needs {field.name}, a number")
    return filled


def _implied_values(row: Function, body: tuple[Field, ...]) -> dict[str, int]:
    """The values that the table fixes: the leading field, and fields with one permitted value."""
    single = {name: values[0] for name, values in row.allowed.items() if len(values) == 1}
    if row.when is not None:
        single[row.when[0]] = row.when[1]
    return {field.name: single[field.name] for field in body if field.name in single}


def _value(row: Function, field: Field, value: object) -> Json:
    if field.name == "value" and row.register_type == "coil":
        value = coil_state(value)
    found = to_json(field, value)
    if field.field_type != "group" or not isinstance(found, list):
        return found
    implied = _implied_values(row, field.children)
    return [{**implied, **item} for item in found if isinstance(item, dict)]


def _exception(value: object) -> int:
    """The exception code from a number or name; `UsageError` otherwise."""
    code = value if isinstance(value, int) else parse_number(str(value))
    if code is not None:
        if not 0 <= code <= MAX_EXCEPTION:
            raise UsageError(f"exception code {code} is not from 0 to {MAX_EXCEPTION}")
        return code
    known = {normalized(entry.name): entry for entry in names("exceptions")}
    entry = known.get(normalized(str(value)))
    if entry is not None:
        return entry.code
    hint = similar_name(str(value), (entry.name for entry in known.values()))
    end = "a code or a name is needed" if hint is None else f"did you mean {hint!r}?"
    raise UsageError(f"no exception {value!r}; {end}")
