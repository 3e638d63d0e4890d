"""What is written for another program is read back: the same points, but for what a note names.

| writer | what comes back |
| --- | --- |
| `toml` | everything, exactly |
| `csv` | everything; semicolons in labels and commas after a setting go, with a note |
| `telegraf` | at, type, order, scale; an array is a field a value |
| `homeassistant` | these, and offset, unit, the first nan, arrays; of single bits the lowest |
"""

from __future__ import annotations

import json
import tomllib
from typing import Any

import pytest
from hypothesis import given, settings
from ruamel.yaml import YAML

from dissectors import importers
from dissectors.importers import FORMATS
from dissectors.importers.profile_builder import REGISTERS_OF_TYPE
from dissectors.profile import Profile, from_model, parse, shipped, shipped_names
from tests.support.profiles import models

Row = dict[str, Any]


def back(form: str, profile: Profile) -> tuple[list[Row], str]:
    """The points that come back, by name, and what was said when they were written."""
    written = importers.write(form, profile)
    if form == "toml":
        rows = parse(written.text, "x.toml").points
    else:
        rows = from_model(importers.read(form, written.text, "x").model, "x").points
    return sorted(rows, key=lambda row: str(row["name"])), "\n".join(written.notes)


def carried(point: Row, profile: Profile, keys: tuple[str, ...]) -> Row:
    """A point with some of its keys, its order said by itself, where it says something."""
    row = {key: point[key] for key in ("at", "name", "type", *keys) if key in point}
    order = point.get("order", profile.device.get("order", "ABCD"))
    if REGISTERS_OF_TYPE.get(point["type"], 1) == 1:
        order = {"CDAB": "ABCD", "DCBA": "BADC"}.get(order, order)
    if order != "ABCD" and point["at"][:2] in ("hr", "ir"):
        row["order"] = order
    return row


def in_telegraf(profile: Profile) -> list[Row]:
    """What Telegraf can say, written down without looking at the writer."""
    rows = []
    for point in profile.points:
        space, place = point["at"].split(":")
        if "-" in place or point["type"] in ("bcd16", "bcd32", "strh", "strl", "raw"):
            continue
        row = carried(point, profile, ("scale", "count"))
        width = REGISTERS_OF_TYPE.get(point["type"])
        if width is None or row.get("count", width) == width:
            rows.append(row)
            continue
        size = row.pop("count")
        for turn in range(size // width):
            at = f"{space}:{int(place) + turn * width}"
            rows.append({**row, "at": at, "name": f"{row['name']}_{turn}"})
    return rows


def in_home_assistant(profile: Profile) -> list[Row]:
    """What Home Assistant can say, written down without looking at the writer."""
    rows = []
    for point in profile.points:
        space, place = point["at"].split(":")
        keys: tuple[str, ...] = ("count",)
        if space in ("hr", "ir") and "." not in place:
            keys = ("count", "scale", "offset", "unit", "nan")
            if point["type"] not in (
                "str",
                *(kind for kind in REGISTERS_OF_TYPE if kind[0] in "usf"),
            ):
                continue
        row = carried(point, profile, keys)
        # A structure names each value, and a swap would turn one half of a register into the other.
        if point["type"].startswith(("u8", "s8")) and (point.get("count", 1) > 1 or "order" in row):
            continue
        if "." in place and (not place.endswith(".0") or "order" in row):
            continue
        if space == "co" and point.get("access", "r") != "r":
            row["access"] = "rw"
            if row.get("count", 1) > 1:
                for turn in range(row.pop("count")):
                    at = f"co:{int(place) + turn}"
                    rows.append({**row, "at": at, "name": f"{row['name']}_{turn}"})
                continue
        if "nan" in row:
            row["nan"] = row["nan"][:1]
        rows.append(row)
    return rows


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_toml_carries_everything(model: Row) -> None:
    """TOML carries the whole model, without a note."""
    profile = from_model(model, "x")
    written = importers.write("toml", profile)
    assert parse(written.text, "x.toml").model == profile.model
    assert written.notes == ()


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_csv_carries_everything(model: Row) -> None:
    """The same model, but for semicolons in labels and commas after a setting: each a note."""
    profile = from_model(model, "x")
    written = importers.write("csv", profile)
    expected = json.loads(json.dumps(profile.model))
    mended = []
    for row in [expected["device"], *expected["registers"]]:
        for key in ("enum", "bits", "exceptions"):
            for raw, label in row.get(key, {}).items():
                row[key][raw] = label.replace(";", ",").strip()
                mended += [key] if row[key][raw] != label else []
    device = expected["device"]
    for table in (device, device.get("exceptions", {})):
        for key, text in table.items():
            if isinstance(text, str) and text.endswith(","):
                table[key] = text.rstrip(",")
                mended.append(key)
    assert importers.read("csv", written.text, "x").model == expected
    assert len(written.notes) <= len(mended)
    assert bool(written.notes) == bool(mended)


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_telegraf_carries_what_it_has_words_for(model: Row) -> None:
    """The rest is named in a note: each key, each point that is left out."""
    profile = from_model(model, "x")
    expected = in_telegraf(profile)
    if not expected:
        return
    rows, notes = back("telegraf", profile)
    assert rows == sorted(expected, key=lambda row: str(row["name"]))
    names = {row["name"] for row in rows}
    for point in profile.points:
        arrays = f"{point['name']}_0" in names
        if point["name"] not in names and not arrays:
            assert f"{point['name']}: " in notes
            assert "cannot be read by Telegraf; skipped" in notes
            continue
        assert not arrays or f"{point['name']}: " in notes
        for key in ("enum", "bits", "nan", "offset", "unit", "access", "group", "note"):
            assert key not in point or f"{key} cannot be kept in Telegraf" in notes
    for key in profile.device:
        assert key in ("address_base", "order") or f"{key} cannot be kept in Telegraf" in notes


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_home_assistant_carries_what_it_has_words_for(model: Row) -> None:
    """The rest is named in a note: each key, each point that is left out."""
    profile = from_model(model, "x")
    expected = in_home_assistant(profile)
    if not expected:
        return
    rows, notes = back("homeassistant", profile)
    assert rows == sorted(expected, key=lambda row: str(row["name"]))
    by_name = {row["name"]: row for row in rows}
    for point in profile.points:
        found = by_name.get(point["name"], by_name.get(f"{point['name']}_0"))
        if f"{point['name']}_0" in by_name:
            assert f"{point['name']}: {point['count']} values, each of them a switch" in notes
        if found is None:
            assert f"{point['name']}: {point['type']} {point['at']} cannot be read" in notes
            continue
        for key in ("enum", "bits", "group", "note", "unit"):
            assert key not in point or key in found or f"{key} cannot be kept in Home" in notes
        if len(point.get("nan", ())) > 1:
            assert "the second value of nan cannot be kept in Home Assistant" in notes
        if point.get("access", "r") != found.get("access", "r"):
            assert "access cannot be kept in Home Assistant" in notes
    for key in profile.device:
        assert key in ("address_base", "order") or f"{key} cannot be kept in Home" in notes


WRITERS = [name for name, form in FORMATS.items() if form.writes]


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("name", shipped_names())
def test_shipped_profiles_come_back(form: str, name: str) -> None:
    """Tables, addresses and types of the profiles that everybody has."""
    profile = shipped(name)
    rows, _ = back(form, profile)
    assert {(row["at"], row["type"]) for row in rows} == {
        (row["at"], row["type"]) for row in profile.points
    }


EDGES = """\
profile = 1
[device]
note = "first line\\nsecond line"
[[registers]]
at = "hr:0"
name = "mode"
enum = {0 = "off; by hand", 1 = "on"}
note = "a \\"quoted\\" word, a comma\\nand a line"
[[registers]]
at = "hr:1"
name = "biggest"
unit = " V"
type = "u64"
nan = 0xFFFFFFFFFFFFFFFF
[[registers]]
at = "hr:5"
name = "flow"
type = "f32"
nan = nan
scale = 1e-5
"""


def test_texts_that_a_cell_cannot_hold_are_altered_with_a_note() -> None:
    """Semicolons part labels, a setting is one line; quotation marks, commas and lines may stay."""
    profile = parse(EDGES, "x.toml")
    written = importers.write("csv", profile)
    assert written.notes == (
        "device.note: written on one line",
        "mode.enum: written with commas instead of semicolons, without spaces at the ends",
        "biggest.unit: written without the spaces at its ends",
    )
    again = parse(written.text, "x.csv").model
    assert again["device"]["note"] == "first line second line"
    assert again["registers"][0]["enum"] == {"0": "off, by hand", "1": "on"}
    assert again["registers"][0]["note"] == 'a "quoted" word, a comma\nand a line'
    biggest = {**profile.points[1], "unit": "V"}
    assert again["registers"][1:] == [biggest, profile.points[2]]


def test_toml_holds_the_edges() -> None:
    """Lines in texts, the biggest whole number, a sentinel that is not a number, small scales."""
    profile = parse(EDGES, "x.toml")
    assert parse(importers.write("toml", profile).text, "x.toml").model == profile.model


ONE_BY_ONE = """\
profile = 1
[[registers]]
at = "hr:0.0"
name = "lowest"
[[registers]]
at = "hr:1.3"
name = "fourth"
[[registers]]
at = "hr:2"
name = "serial"
type = "str"
count = 4
[[registers]]
at = "hr:6"
name = "powers"
type = "f32"
count = 4
unit = "W"
nan = [1, 2]
[[registers]]
at = "co:0"
name = "pumps"
access = "rw"
count = 3
"""


def test_telegraf_word_by_word() -> None:
    """The file as its documentation has it, and what was said."""
    written = importers.write("telegraf", parse(ONE_BY_ONE, "x.toml"))
    assert tomllib.loads(written.text) == {
        "inputs": {"modbus": [{
            "name": "modbus",
            "configuration_type": "request",
            "request": [
                {"slave_id": 1, "byte_order": "ABCD", "register": "holding", "fields": [
                    {"address": 0, "name": "lowest", "type": "BIT", "bit": 0},
                    {"address": 1, "name": "fourth", "type": "BIT", "bit": 3},
                    {"address": 2, "name": "serial", "type": "STRING", "length": 4},
                    {"address": 6, "name": "powers_0", "type": "FLOAT32"},
                    {"address": 8, "name": "powers_1", "type": "FLOAT32"},
                ]},
                {"slave_id": 1, "byte_order": "ABCD", "register": "coil", "fields": [
                    {"address": 0, "name": "pumps_0"},
                    {"address": 1, "name": "pumps_1"},
                    {"address": 2, "name": "pumps_2"},
                ]},
            ],
        }]}
    }  # fmt: skip
    assert written.notes == (
        "slave_id = 1 is an example",
        "powers: 2 values, each of them a field",
        "pumps: 3 values, each of them a field",
        "nan cannot be kept in Telegraf: powers",
        "unit cannot be kept in Telegraf: powers",
        "access cannot be kept in Telegraf: pumps",
    )


def test_home_assistant_word_by_word() -> None:
    """The file as its documentation has it, and what was said."""
    written = importers.write("homeassistant", parse(ONE_BY_ONE, "x.toml"))
    (hub,) = YAML(typ="safe").load(written.text)["modbus"]
    assert hub["binary_sensors"] == [
        {"name": "lowest", "address": 0, "slave": 1, "input_type": "holding"}
    ]
    assert hub["switches"] == [
        {"name": f"pumps_{turn}", "address": turn, "slave": 1, "write_type": "coil"}
        for turn in range(3)
    ]
    holding = {"slave": 1, "input_type": "holding"}
    assert hub["sensors"] == [
        {"name": "serial", "address": 2, **holding, "data_type": "string", "count": 4},
        {"name": "powers", "address": 6, **holding, "data_type": "float32", "virtual_count": 1,
         "unit_of_measurement": "W", "nan_value": 1},
    ]  # fmt: skip
    assert written.notes == (
        "port, line settings and slave: 1 are examples",
        "fourth: bool hr:1.3 cannot be read; skipped",
        "pumps: 3 values, each of them a switch",
        "the second value of nan cannot be kept in Home Assistant: powers",
    )


def test_scale_factors_in_other_registers() -> None:
    """TOML and CSV carry them; for the others they are a note, as the value is without them."""
    profile = parse(
        'profile = 1\n[[registers]]\nat = "hr:0"\nname = "power"\nsf = "exponent"\n'
        '[[registers]]\nat = "hr:1"\nname = "exponent"\ntype = "s16"\n',
        "x.toml",
    )
    for form in ("toml", "csv"):
        assert back(form, profile) == (sorted(profile.points, key=lambda row: str(row["name"])), "")
    assert "sf cannot be kept in Telegraf: power" in back("telegraf", profile)[1]
    assert "sf cannot be kept in Home Assistant: power" in back("homeassistant", profile)[1]
