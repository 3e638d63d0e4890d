"""ESPHome's `modbus_controller`; addresses as on the wire.

Substitutions of the same file are resolved; packages are not, and lambdas are not understood: each
is a note.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from dissectors.errors import ProfileError, UsageError
from dissectors.function_lookup import parse_number
from dissectors.importers.profile_builder import (
    REGISTERS_OF_TYPE,
    Imported,
    NotConvertible,
    Options,
    ProfileBuilder,
    parse_decimal,
)
from dissectors.yaml import plain_data, tag_notes

__all__ = ["read"]

_LISTS = ("sensor", "binary_sensor", "number", "select", "switch", "text_sensor", "output")
_WRITTEN = ("number", "select", "switch", "output")
_TABLES = {"coil": "co", "discrete_input": "di", "holding": "hr", "read": "ir", "input": "ir"}
_KINDS = {
    "U_WORD": "u16", "S_WORD": "s16", "U_DWORD": "u32", "S_DWORD": "s32", "U_QWORD": "u64",
    "S_QWORD": "s64", "FP32": "f32",
}  # fmt: skip
_RAW_TEXTS = ("HEXBYTES", "COMMA")
"""`raw_encode` of text sensors that show the bytes, not their characters."""
_KNOWN = {
    "platform", "modbus_controller_id", "name", "id", "address", "register_type", "value_type",
    "bitmask", "offset", "byte_offset", "filters", "multiply", "unit_of_measurement", "optionsmap",
}  # fmt: skip
_NO_MASK = 0xFFFFFFFF
_SIZES = {"register_count", "response_size"}
_SUBSTITUTION = re.compile(r"\$(?:\{(\w+)\}|(\w+))")
_SUBSTITUTION_DEPTH = 5


def read(text: str, name: str, options: Options) -> Imported:
    """Read the entities on modbus_controller; `ProfileError` where there are none."""
    data, tags = plain_data(text, name)
    data = _substituted(data)
    rows = list(_entities(data)) if isinstance(data, Mapping) else []
    if not rows:
        line, tag = tags[0] if tags else (None, "")
        hint = f"; {tag.split()[0]} is not followed: import that file" if tags else ""
        message = f"no entity on platform modbus_controller in it{hint}"
        raise ProfileError(message, path=name, line=line)
    wanted = _controller(data, options, name)
    builder = ProfileBuilder({"source": f"ESPHome configuration {name}"}, options.order)
    builder.notes.append("addresses count from 0, as ESPHome does")
    builder.notes += tag_notes(tags, "is not understood")
    builder.note_dropped((key for key in ("packages",) if key in data), "is not resolved")
    for kind, row in rows:
        if wanted is None or row.get("modbus_controller_id") in (None, wanted):
            with builder.noting_failures(_label(row)):
                _add(builder, kind, row)
    return builder.build()


_SUBSTITUTED = ("defaults", "substitutions")


def _substituted(data: Any) -> Any:
    """The configuration with `$name` and `${name}` replaced by the file's `substitutions`.

    A package has `defaults` for those of the files that include it.

    >>> _substituted({"substitutions": {"what": "flow"}, "sensor": [{"name": "${what} 1"}]})
    {'sensor': [{'name': 'flow 1'}]}
    """
    if not isinstance(data, Mapping):
        return data
    said = [data[key] for key in _SUBSTITUTED if isinstance(data.get(key), Mapping)]
    values = {str(key): str(value) for table in said for key, value in table.items()}

    def resolve(node: Any) -> Any:
        if isinstance(node, Mapping):
            return {resolve(key): resolve(value) for key, value in node.items()}
        if isinstance(node, list):
            return [resolve(item) for item in node]
        if not isinstance(node, str):
            return node
        for _ in range(_SUBSTITUTION_DEPTH):  # a value may name another one
            text = _SUBSTITUTION.sub(lambda match: values.get(match[1] or match[2], match[0]), node)
            if text == node:
                break
            node = text
        number = parse_number(node)
        return node if number is None else number

    if not values:
        return data
    return resolve({key: value for key, value in data.items() if key not in _SUBSTITUTED})


def _controller(data: Mapping[str, Any], options: Options, name: str) -> str | None:
    """The id of the controller with the chosen unit; None where there is only one controller."""
    rows = [one for one in _list(data.get("modbus_controller")) if isinstance(one, Mapping)]
    known = {str(one.get("id")): one.get("address") for one in rows}
    for controller, unit in known.items():
        if options.unit is not None and unit == options.unit:
            return controller
    told = options.unit is not None and known
    if not told and len(known) < 2:  # noqa: PLR2004 - nothing to choose
        return None
    there = ", ".join(f"{unit} ({controller})" for controller, unit in known.items())
    raise UsageError(f"{name}: choose a unit with --unit N; there are {there}")


def _entities(data: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for key in _LISTS:
        for row in _list(data.get(key)):
            if isinstance(row, Mapping) and row.get("platform") == "modbus_controller":
                yield key, row


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]


def _label(row: Mapping[str, Any]) -> str:
    return str(row.get("name", row.get("id", "")))


def _add(builder: ProfileBuilder, kind: str, row: Mapping[str, Any]) -> None:
    """Add the point of an entity, `kind` being the list that it is in.

    The offset counts bytes of registers and bits of coils.
    """
    label = _label(row)
    address, shift = (
        parse_decimal(row.get("address")),
        _whole_number(row, ("byte_offset", "offset"), 0),
    )
    if not isinstance(address, int):
        raise NotConvertible("no address")
    space = _TABLES.get(str(row.get("register_type", "holding")))
    if space is None:
        raise NotConvertible(f"register_type {row['register_type']!r} is not known")
    _note_unsupported(builder, kind, row)
    access = "rw" if kind in _WRITTEN else None
    if space in ("co", "di"):
        # For coils the offset counts bits, and a bitmask of 1 is the coil itself.
        if row.get("bitmask", 1) != 1:
            builder.note_dropped([f"bitmask {row['bitmask']!r} of a coil"])
        builder.add(label, space, address + shift, access=access)
        return
    if shift % 2:
        raise NotConvertible(f"begins at byte {shift}, inside a register")
    word, count, order = _type(row, kind)
    address, word, part = _apply_bitmask(row, address + shift // 2, word, order)
    # What a lambda makes of the value is not known, so nothing that follows it is applied either.
    scale, offset = (None, None) if "lambda" in row else _filters(builder, row)
    builder.add(
        label,
        space,
        address,
        part=part,
        type=None if word == "u16" else word,
        count=count,
        order=order,
        scale=scale,
        offset=offset,
        # The unit is that of the value which the lambda makes.
        unit=None if "lambda" in row else row.get("unit_of_measurement"),
        access=access,
        enum=_labels(builder, row),
    )


def _note_unsupported(builder: ProfileBuilder, kind: str, row: Mapping[str, Any]) -> None:
    """Add notes on the keys of an entity that a point cannot have."""
    label = _label(row)
    texts = kind == "text_sensor"
    known = _KNOWN | (_SIZES | {"raw_encode"} if texts or "value_type" in row else set())
    builder.note_dropped(sorted(str(key) for key in set(row) - known if "lambda" not in str(key)))
    for key in ("lambda", "write_lambda"):
        if key in row:
            builder.notes.append(f"{label}: {key} is not understood; the value is the raw one")
    if "${" in label:
        builder.notes.append(f"{label}: no such substitution in this file")


def _whole_number(row: Mapping[str, Any], keys: tuple[str, ...], nothing: int) -> int:
    """The whole number of the first of these keys that is present."""
    for key in keys:
        if row.get(key) is not None:
            found = parse_decimal(row[key])
            if not isinstance(found, int) or found < 0:
                raise NotConvertible(f"{key} {row[key]!r} is not a whole number")
            return found
    return nothing


def _type(row: Mapping[str, Any], kind: str) -> tuple[str, int | None, str | None]:
    """The type, the registers of a text or of raw bytes, and the order.

    `NotConvertible` where the type is unknown.
    """
    word = str(row.get("value_type", "U_WORD"))
    if kind == "text_sensor" or word == "RAW":
        size = _whole_number(
            row, ("response_size",), 2 * _whole_number(row, ("register_count",), 1)
        )
        raw = kind != "text_sensor" or row.get("raw_encode") in _RAW_TEXTS
        return "raw" if raw else "str", max((size + 1) // 2, 1), None
    found = _KINDS.get(word.removesuffix("_R"))
    if found is None:
        raise NotConvertible(f"value_type {word} is not known")
    return found, None, "CDAB" if word.endswith("_R") else None


def _apply_bitmask(
    row: Mapping[str, Any], address: int, word: str, order: str | None
) -> tuple[int, str, tuple[int, int] | None]:
    """Register, type and bits (first and last) of what a bitmask leaves of a whole number.

    >>> _apply_bitmask({"bitmask": 0xF0}, 5, "u16", None)
    (5, 'u16', (4, 7))
    >>> _apply_bitmask({"bitmask": 0xFFFF}, 5, "u32", None)
    (6, 'u16', None)
    >>> _apply_bitmask({"bitmask": 0x8000}, 5, "u32", "CDAB")
    (5, 'u16', (15, 15))
    """
    mask, width = _whole_number(row, ("bitmask",), _NO_MASK), REGISTERS_OF_TYPE.get(word, 1)
    everything = (1 << 16 * width) - 1
    if mask in (_NO_MASK, everything) or word in ("f32", "str", "raw"):
        return address, word, None
    low, high = (mask & -mask).bit_length() - 1, mask.bit_length() - 1
    run = mask >> max(low, 0)
    if not 0 < mask <= everything or run & (run + 1) or low // 16 != high // 16:
        raise NotConvertible(
            f"bitmask {row['bitmask']!r} is not a contiguous run of bits of a register"
        )
    from_right = low // 16
    register = address + (from_right if order == "CDAB" else width - 1 - from_right)
    whole = high - low == 15  # noqa: PLR2004 - all bits of a register
    return register, "u16", None if whole else (low % 16, high % 16)


def _labels(builder: ProfileBuilder, row: Mapping[str, Any]) -> dict[str, str]:
    """The labels of a select by raw value; ESPHome has them the other way round."""
    table = row.get("optionsmap")
    if not isinstance(table, Mapping):
        return {}
    labels = {}
    for option, raw in table.items():
        value = parse_decimal(raw)
        if isinstance(value, int) and option is not None:
            labels[str(value)] = str(option)
        else:
            builder.notes.append(
                f"{_label(row)}: option {option!r}: {raw!r} is not a raw value; skipped"
            )
    return labels


def _filters(
    builder: ProfileBuilder, row: Mapping[str, Any]
) -> tuple[int | float | None, int | float | None]:
    """Scale and offset that the `multiply` and `offset` filters have together."""
    scale, offset = 1.0, 0.0
    if kind := parse_decimal(row.get("multiply")):
        # `multiply` of a number entity is the factor by which a value is multiplied before it is
        # written.
        scale /= kind
    for one in _list(row.get("filters")):
        pair = next(iter(one.items())) if isinstance(one, Mapping) and one else (one, None)
        value = parse_decimal(pair[1]) if not isinstance(pair[1], Mapping | list) else None
        if pair[0] == "multiply" and value is not None:
            scale, offset = scale * value, offset * value
        elif pair[0] == "offset" and value is not None:
            offset += value
        else:
            builder.note_dropped([f"filter {pair[0]}"])
    scale, offset = round(scale, 12), round(offset, 12)
    return None if scale in (1, 0) else parse_decimal(
        scale
    ), None if offset == 0 else parse_decimal(offset)
