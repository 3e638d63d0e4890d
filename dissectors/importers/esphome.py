"""ESPHome's `modbus_controller`; addresses as on the wire.

Substitutions and packages are not resolved, lambdas not understood: each is a note.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dissectors.errors import ProfileError, UsageError
from dissectors.importers.draft import Draft, Imported, Options, tidy
from dissectors.yaml import plain_data

__all__ = ["read"]

_LISTS = ("sensor", "binary_sensor", "number", "select", "switch", "text_sensor", "output")
_TABLES = {"coil": "co", "discrete_input": "di", "holding": "hr", "read": "ir", "input": "ir"}
_KINDS = {
    "U_WORD": "u16", "S_WORD": "s16", "U_DWORD": "u32", "S_DWORD": "s32", "U_QWORD": "u64",
    "S_QWORD": "s64", "FP32": "f32",
}  # fmt: skip
_KNOWN = {
    "platform", "modbus_controller_id", "name", "id", "address", "register_type", "value_type",
    "bitmask", "offset", "byte_offset", "register_count", "response_size", "filters", "multiply",
    "unit_of_measurement", "optionsmap",
}  # fmt: skip


def read(text: str, name: str, options: Options) -> Imported:
    """The entities on modbus_controller; `ProfileError` where there are none."""
    data, tags = plain_data(text, name)
    rows = list(_entities(data)) if isinstance(data, Mapping) else []
    if not rows:
        raise ProfileError("no entity on platform modbus_controller in it", path=name)
    controllers = {
        str(one.get("id")): one.get("address")
        for one in _list(data.get("modbus_controller"))
        if isinstance(one, Mapping)
    }
    wanted = _controller(controllers, options, name)
    draft = Draft({"source": f"ESPHome configuration {name}"})
    draft.notes.append("addresses count from 0, as ESPHome does")
    draft.notes += [f"line {line}: {tag} is not understood; left out" for line, tag in tags]
    draft.dropped((key for key in ("substitutions", "packages") if key in data), "is not resolved")
    for kind, row in rows:
        if wanted is None or row.get("modbus_controller_id") in (None, wanted):
            _add(draft, kind, row, options)
    return draft.done()


def _controller(known: Mapping[str, Any], options: Options, name: str) -> str | None:
    if len(known) < 2:  # noqa: PLR2004 - nothing to choose
        return None
    for controller, unit in known.items():
        if options.unit is not None and unit == options.unit:
            return controller
    units = ", ".join(f"{unit} ({controller})" for controller, unit in known.items())
    raise UsageError(f"{name}: units {units}; --unit N chooses one")


def _entities(data: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for key in _LISTS:
        for row in _list(data.get(key)):
            if isinstance(row, Mapping) and row.get("platform") == "modbus_controller":
                yield key, row


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]


def _add(draft: Draft, kind: str, row: Mapping[str, Any], options: Options) -> None:
    label = str(row.get("name", row.get("id", "")))
    draft.dropped(sorted(set(row) - _KNOWN))
    if "${" in label:
        draft.notes.append(f"{label}: substitutions are not resolved")
    address = tidy(row.get("address"))
    if not isinstance(address, int):
        draft.notes.append(f"{label}: no address; left out")
        return
    shift = int(tidy(row.get("byte_offset", row.get("offset", 0))) or 0)
    space = _TABLES.get(str(row.get("register_type", "holding")), "hr")
    access = "rw" if kind in ("number", "select", "switch", "output") else None
    if space in ("co", "di"):
        # Of coils the offset counts bits.
        draft.add(label, space, address + shift, access=access)
        return
    if shift % 2:
        draft.notes.append(f"{label}: begins at byte {shift}, inside a register; left out")
        return
    address += shift // 2
    part = _mask(row.get("bitmask"))
    if part == ():
        draft.notes.append(f"{label}: bitmask {row['bitmask']!r} is no run of bits; left out")
        return
    words = _type(row, kind)
    if words is None:
        draft.notes.append(f"{label}: {row.get('value_type', 'RAW')} is not understood; left out")
        return
    word_type, count, order = words
    scale, offset = _filters(draft, row, label)
    bits = (part[0], part[1]) if part else None
    draft.add(
        label,
        space,
        address,
        part=bits,
        type=None if bits or word_type == "u16" else word_type,
        count=count,
        order=order or (options.order if options.order != "ABCD" and not bits else None),
        scale=scale,
        offset=offset,
        unit=row.get("unit_of_measurement"),
        access=access,
        enum={str(raw): option for option, raw in (row.get("optionsmap") or {}).items()},
    )


def _type(row: Mapping[str, Any], kind: str) -> tuple[str, int | None, str | None] | None:
    if kind == "text_sensor":
        size = int(row.get("response_size") or 2 * int(row.get("register_count") or 1))
        return "str", (size + 1) // 2, None
    default = "RAW" if "lambda" in row and "value_type" not in row else "U_WORD"
    word = str(row.get("value_type", default))
    found = _KINDS.get(word.removesuffix("_R"))
    return None if found is None else (found, None, "CDAB" if word.endswith("_R") else None)


def _mask(mask: Any) -> tuple[int, ...] | None:
    """First and last bit of a mask; None for none, () where it is no run of bits of a register.

    >>> _mask(0xF0), _mask(0x8000), _mask(0x5), _mask(None)
    ((4, 7), (15, 15), (), None)
    """
    number = tidy(mask)
    if number in (None, 0xFFFF, 0xFFFFFFFF):
        return None
    if not isinstance(number, int) or not 0 < number <= 0xFFFF:  # noqa: PLR2004
        return ()
    low = (number & -number).bit_length() - 1
    run = number >> low
    return () if run & (run + 1) else (low, number.bit_length() - 1)


def _filters(
    draft: Draft, row: Mapping[str, Any], label: str
) -> tuple[int | float | None, int | float | None]:
    """Scale and offset of `multiply` and `offset` filters, one after the other."""
    scale, offset = 1.0, 0.0
    if kind := tidy(row.get("multiply")):
        scale /= kind  # of a number: what the value is multiplied by before it is written
    for one in _list(row.get("filters")):
        pair = next(iter(one.items())) if isinstance(one, Mapping) and one else (one, None)
        value = tidy(pair[1]) if not isinstance(pair[1], Mapping | list) else None
        if pair[0] == "multiply" and value is not None:
            scale, offset = scale * value, offset * value
        elif pair[0] == "offset" and value is not None:
            offset += value
        else:
            draft.dropped([f"filter {pair[0]}"])
    scale, offset = round(scale, 12), round(offset, 12)
    return None if scale in (1, 0) else tidy(scale), None if offset == 0 else tidy(offset)
