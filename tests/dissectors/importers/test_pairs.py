"""The same map through two importers gives the same profile: every pair, all that both can say.

Each point below is written down for every program that has words for it. Two programs are compared
by one file each, of all points that both can say.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest

from tests.support.importing import imported

Say = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Point:
    """A point, and how each program says it."""

    expected: dict[str, Any]
    csv: Say = field(default_factory=dict)
    kepware: Say = field(default_factory=dict)
    telegraf: Say = field(default_factory=dict)
    homeassistant: Say = field(default_factory=dict)
    esphome: Say = field(default_factory=dict)
    sunspec: Say = field(default_factory=dict)


def number(
    kind: str, at: int, width: int, words: tuple[str, str, str | None, str | None, str], **keys: Any
) -> Point:
    """A number of holding registers.

    `words` are its types: of CSV and Kepware, Telegraf, Home Assistant, ESPHome, SunSpec.
    """
    short, telegraf, home, esphome, sunspec = words
    order = {} if width == 1 else {"order": "ABCD"}
    return Point(
        {"at": f"hr:{at}", "type": kind, **keys},
        csv={"Address": at, "Type": short},
        kepware={"Address": 400001 + at, "Data Type": short, **order},
        telegraf={"register": "holding", "address": at, "type": telegraf},
        homeassistant={"sensors": {"address": at, "data_type": home}} if home else {},
        esphome={"sensor": {"address": at, "value_type": esphome}} if esphome else {},
        sunspec={"type": sunspec, "size": width, "at": at} if sunspec else {},
    )


def ordered(order: str, at: int, swap: str, telegraf: str, esphome: str | None) -> Point:
    """A float whose bytes are in an order."""
    return Point(
        {"at": f"hr:{at}", "type": "f32", "order": order},
        csv={"Address": at, "Type": "float", "Order": order},
        telegraf={"register": "holding", "address": at, "type": "FLOAT32", "order": telegraf},
        homeassistant={"sensors": {"address": at, "data_type": "float32", "swap": swap}},
        esphome={"sensor": {"address": at, "value_type": esphome}} if esphome else {},
        kepware={"Address": 400001 + at, "Data Type": "Float"} if order == "CDAB" else {},
    )


POINTS = {
    "coil": Point(
        {"at": "co:5", "type": "bool"},
        csv={"Table": "coil", "Address": 5},
        kepware={"Address": "000006", "Data Type": "Boolean"},
        telegraf={"register": "coil", "address": 5},
        homeassistant={"binary_sensors": {"address": 5, "input_type": "coil"}},
        esphome={"binary_sensor": {"address": 5, "register_type": "coil"}},
    ),
    "written_coil": Point(
        {"at": "co:6", "type": "bool", "access": "rw"},
        csv={"Table": "coil", "Address": 6, "Access": "rw"},
        kepware={"Address": "000007", "Data Type": "Boolean", "Client Access": "R/W"},
        homeassistant={"switches": {"address": 6, "write_type": "coil"}},
        esphome={"switch": {"address": 6, "register_type": "coil"}},
    ),
    "discrete": Point(
        {"at": "di:5", "type": "bool"},
        csv={"Table": "discrete", "Address": 5},
        kepware={"Address": "100006", "Data Type": "Boolean"},
        telegraf={"register": "discrete", "address": 5},
        homeassistant={"binary_sensors": {"address": 5, "input_type": "discrete_input"}},
        esphome={"binary_sensor": {"address": 5, "register_type": "discrete_input"}},
    ),
    "input": Point(
        {"at": "ir:7", "type": "s16"},
        csv={"Table": "input", "Address": 7, "Type": "int16"},
        kepware={"Address": 300008, "Data Type": "Short"},
        telegraf={"register": "input", "address": 7, "type": "INT16"},
        homeassistant={"sensors": {"address": 7, "input_type": "input", "data_type": "int16"}},
        esphome={"sensor": {"address": 7, "register_type": "read", "value_type": "S_WORD"}},
    ),
    "u16": number("u16", 10, 1, ("Word", "UINT16", "uint16", "U_WORD", "acc16")),
    "s16": number("s16", 11, 1, ("Short", "INT16", "int16", "S_WORD", "")),
    "u32": number("u32", 12, 2, ("DWord", "UINT32", "uint32", "U_DWORD", "acc32")),
    "s32": number("s32", 14, 2, ("Long", "INT32", "int32", "S_DWORD", "")),
    "u64": number("u64", 16, 4, ("QWord", "UINT64", "uint64", "U_QWORD", "acc64")),
    "s64": number("s64", 20, 4, ("LLong", "INT64", "int64", "S_QWORD", "")),
    "f32": number("f32", 24, 2, ("Float", "FLOAT32", "float32", "FP32", "float32")),
    "f64": number("f64", 26, 4, ("Double", "FLOAT64", "float64", None, "float64")),
    "f16": Point(
        {"at": "hr:30", "type": "f16"},
        csv={"Address": 30, "Type": "float16"},
        telegraf={"register": "holding", "address": 30, "type": "FLOAT16"},
        homeassistant={"sensors": {"address": 30, "data_type": "float16"}},
    ),
    "low_half": Point(
        {"at": "hr:31", "type": "u8l"},
        csv={"Address": "31.lo"},
        kepware={"Address": 400032, "Data Type": "Byte"},
        telegraf={"register": "holding", "address": 31, "type": "UINT8L"},
    ),
    "high_half": Point(
        {"at": "hr:32", "type": "s8h"},
        csv={"Address": "32.hi", "Type": "int8"},
        telegraf={"register": "holding", "address": 32, "type": "INT8H"},
    ),
    "CDAB": ordered("CDAB", 40, "word", "CDAB", "FP32_R"),
    "BADC": ordered("BADC", 42, "byte", "BADC", None),
    "DCBA": ordered("DCBA", 44, "word_byte", "DCBA", None),
    "bytes_of_one_register": Point(
        {"at": "hr:46", "type": "s16", "order": "BADC"},
        csv={"Address": 46, "Type": "int16", "Order": "BADC"},
        telegraf={"register": "holding", "address": 46, "type": "INT16", "order": "BADC"},
        homeassistant={"sensors": {"address": 46, "data_type": "int16", "swap": "byte"}},
    ),
    "text": Point(
        {"at": "hr:50", "type": "str", "count": 4},
        csv={"Address": 50, "Type": "string", "Count": 4},
        kepware={"Address": "400051.8H", "Data Type": "String"},
        telegraf={"register": "holding", "address": 50, "type": "STRING", "length": 4},
        homeassistant={"sensors": {"address": 50, "data_type": "string", "count": 4}},
        esphome={"text_sensor": {"address": 50, "register_count": 4}},
        sunspec={"type": "string", "size": 4, "at": 50},
    ),
    "swapped_text": Point(
        {"at": "hr:54", "type": "str", "count": 4, "order": "BADC"},
        csv={"Address": 54, "Type": "string", "Count": 4, "Order": "BADC"},
        kepware={"Address": "400055.8L", "Data Type": "String"},
        telegraf={
            "register": "holding", "address": 54, "type": "STRING", "length": 4, "order": "BADC",
        },
        homeassistant={
            "sensors": {"address": 54, "data_type": "string", "count": 4, "swap": "byte"}
        },
    ),
    "raw": Point(
        {"at": "hr:58", "type": "raw", "count": 2},
        csv={"Address": 58, "Type": "raw", "Count": 2},
        esphome={"sensor": {"address": 58, "value_type": "RAW", "register_count": 2}},
        sunspec={"type": "ipaddr", "size": 2, "at": 58},
    ),
    "bit": Point(
        {"at": "hr:60.0", "type": "bool"},
        csv={"Address": "60.0"},
        kepware={"Address": "400061.0", "Data Type": "Boolean"},
        telegraf={"register": "holding", "address": 60, "type": "BIT", "bit": 0},
        homeassistant={"binary_sensors": {"address": 60, "input_type": "holding"}},
        esphome={"binary_sensor": {"address": 60, "bitmask": 1}},
    ),
    "highest_bit": Point(
        {"at": "hr:61.15", "type": "bool"},
        csv={"Address": "61.15"},
        kepware={"Address": "400062.15", "Data Type": "Boolean"},
        telegraf={"register": "holding", "address": 61, "type": "BIT", "bit": 15},
        esphome={"binary_sensor": {"address": 61, "bitmask": 0x8000}},
    ),
    "array": Point(
        {"at": "hr:70", "type": "u32", "count": 6},
        csv={"Address": "70-75", "Type": "uint32"},
        kepware={"Address": "400071 [3]", "Data Type": "DWord Array", "order": "ABCD"},
        homeassistant={"sensors": {"address": 70, "data_type": "uint32", "virtual_count": 2}},
    ),
    "scaled": Point(
        {"at": "hr:80", "type": "s16", "scale": 0.1},
        csv={"Address": 80, "Type": "int16", "Scale": 0.1},
        kepware={"Address": 400081, "Data Type": "Short", "limits": "Linear,0,1000,0,100"},
        telegraf={"register": "holding", "address": 80, "type": "INT16", "scale": 0.1},
        homeassistant={"sensors": {"address": 80, "data_type": "int16", "scale": 0.1}},
        esphome={"sensor": {"address": 80, "value_type": "S_WORD", "filters": [{"multiply": 0.1}]}},
    ),
    "scaled_with_offset": Point(
        {"at": "hr:81", "type": "u16", "scale": 0.5, "offset": -40},
        csv={"Address": 81, "Scale": 0.5, "Offset": -40},
        kepware={"Address": 400082, "Data Type": "Word", "limits": "Linear,0,100,-40,10"},
        homeassistant={
            "sensors": {"address": 81, "data_type": "uint16", "scale": 0.5, "offset": -40}
        },
        esphome={"sensor": {"address": 81, "filters": [{"multiply": 0.5}, {"offset": -40}]}},
    ),
    "unit": Point(
        {"at": "hr:82", "type": "u16", "unit": "kWh"},
        csv={"Address": 82, "Unit": "kWh"},
        kepware={"Address": 400083, "Data Type": "Word", "Eng Units": "kWh"},
        homeassistant={
            "sensors": {"address": 82, "data_type": "uint16", "unit_of_measurement": "kWh"}
        },
        esphome={"sensor": {"address": 82, "unit_of_measurement": "kWh"}},
        sunspec={"type": "acc16", "size": 1, "at": 82, "units": "kWh"},
    ),
    "no_value": Point(
        {"at": "hr:83", "type": "s16", "nan": [0x8000]},
        csv={"Address": 83, "Type": "int16", "NaN": "0x8000"},
        homeassistant={"sensors": {"address": 83, "data_type": "int16", "nan_value": 0x8000}},
        sunspec={"type": "int16", "size": 1, "at": 83},
    ),
    "labels": Point(
        {"at": "hr:84", "type": "u16", "access": "rw", "enum": {"0": "Off", "1": "On"}},
        csv={"Address": 84, "Access": "rw", "Enum": "0=Off;1=On"},
        esphome={"select": {"address": 84, "optionsmap": {"Off": 0, "On": 1}}},
    ),
    "note": Point(
        {"at": "hr:85", "type": "u16", "note": "as printed"},
        csv={"Address": 85, "Description": "as printed"},
        kepware={"Address": 400086, "Data Type": "Word", "Description": "as printed"},
        sunspec={"type": "acc16", "size": 1, "at": 85, "label": "as printed"},
    ),
    "exponent": Point(
        {"at": "hr:86", "type": "u16", "scale": 0.01},
        csv={"Address": 86, "Scale": "1/100"},
        sunspec={"type": "acc16", "size": 1, "at": 86, "sf": -2},
        telegraf={"register": "holding", "address": 86, "type": "UINT16", "scale": 0.01},
    ),
}  # fmt: skip

HEADER_WORDS = (
    "Name", "Table", "Address", "Type", "Count", "Order", "Scale", "Offset", "Unit", "Access",
    "Enum", "NaN", "Description",
)  # fmt: skip


def csv(rows: dict[str, Say]) -> str:
    """A table with semicolons, the labels in quotation marks."""
    lines = [";".join(HEADER_WORDS)]
    for name, say in rows.items():
        cells = {"Name": name, "Table": "holding", **say}
        lines.append(";".join(f'"{cells.get(head, "")}"' for head in HEADER_WORDS))
    return "\n".join(lines) + "\n"


def kepware(rows: dict[str, Say]) -> str:
    """An exported list of tags."""
    lines = [
        "Tag Name,Address,Data Type,Respect Data Type,Client Access,Scan Rate,Scaling,Raw Low,Raw "
        "High,Scaled Low,Scaled High,Eng Units,Description"
    ]
    for name, say in rows.items():
        limits = say.get("limits", "None,,,,")
        cells = [name, say["Address"], say["Data Type"], 1, say.get("Client Access", "RO"), 100]
        rest = [limits, say.get("Eng Units", ""), say.get("Description", "")]
        lines.append(",".join(str(cell) for cell in [*cells, *rest]))
    return "\n".join(lines) + "\n"


def telegraf(rows: dict[str, Say]) -> str:
    """A request for every field: its order and table are there."""
    text = '[[inputs.modbus]]\nconfiguration_type = "request"\n'
    for name, say in rows.items():
        row = {key: value for key, value in say.items() if key not in ("register", "order")}
        inner = ", ".join(f"{key} = {json.dumps(value)}" for key, value in row.items())
        text += (
            f'[[inputs.modbus.request]]\nslave_id = 3\nregister = "{say["register"]}"\n'
            f'byte_order = "{say.get("order", "ABCD")}"\n'
            f'fields = [ {{ name = "{name}", {inner} }} ]\n'
        )
    return text


def homeassistant(rows: dict[str, Say]) -> str:
    """A hub; JSON is YAML."""
    hub: dict[str, Any] = {"name": "hub"}
    for name, say in rows.items():
        for key, row in say.items():
            hub.setdefault(key, []).append({"name": name, "slave": 3, **row})
    return json.dumps({"modbus": [hub]})


def esphome(rows: dict[str, Say]) -> str:
    """A node; JSON is YAML."""
    node: dict[str, Any] = {}
    for name, say in rows.items():
        for key, row in say.items():
            node.setdefault(key, []).append({"platform": "modbus_controller", "name": name, **row})
    return json.dumps(node)


def sunspec(rows: dict[str, Say]) -> str:
    """A model whose points stand where they have to, by padding."""
    points: list[Say] = []
    end = 0
    for name, say in sorted(rows.items(), key=lambda row: int(row[1]["at"])):
        if say["at"] > end:
            points.append({"name": f"Pad{end}", "type": "pad", "size": say["at"] - end})
        points.append({"name": name, **{key: say[key] for key in say if key != "at"}})
        end = say["at"] + say["size"]
    return json.dumps({"id": 64000, "group": {"points": points}})


WRITERS: dict[str, Callable[[dict[str, Say]], str]] = {
    "csv": csv,
    "kepware": kepware,
    "telegraf": telegraf,
    "homeassistant": homeassistant,
    "esphome": esphome,
    "sunspec": sunspec,
}


def profile(program: str, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The points, by name, of one file of a program in which they all stand.

    Kepware's order is a setting of the device: a file of both orders is two devices.
    """
    found: dict[str, dict[str, Any]] = {}
    for order in ("CDAB", "ABCD") if program == "kepware" else (None,):
        said = {name: getattr(POINTS[name], program) for name in names}
        if program == "kepware":
            said = {name: say for name, say in said.items() if say.get("order", "CDAB") == order}
        if said:
            form = "csv" if program == "kepware" else program
            rows = imported(form, WRITERS[program](said), order=order)["registers"]
            found |= {row.pop("name"): row for row in rows}
    return found


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations(WRITERS, 2)))
def test_two_importers_give_the_same_profile(one: str, other: str) -> None:
    """All points that both programs have words for, and each as it has to be."""
    names = [
        name for name, point in POINTS.items() if getattr(point, one) and getattr(point, other)
    ]
    assert len(names) >= 4
    expected = {name: POINTS[name].expected for name in names}
    assert profile(one, names) == profile(other, names) == expected


def test_every_point_is_the_same_from_two_programs() -> None:
    """A point of one program alone would compare nothing."""
    for name, point in POINTS.items():
        assert sum(bool(getattr(point, program)) for program in WRITERS) > 1, name
